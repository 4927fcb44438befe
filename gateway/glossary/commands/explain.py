"""`treadlink explain`: what a word of this program means."""

import click


@click.command()
@click.argument("words", nargs=-1, required=True, metavar="WORD...")
def explain(words: tuple[str, ...]) -> None:
    """Explain a quantity, an effect, a reason, a status, a column or a term.

    WORD is the name on a screen or in a file, such as `Cw`, `ply steer peak`, `contact_length_m`, `run-out`,
    `samples_lost` or `provisional`. A part of a name lists all that contain it; else a word of their texts does.

    Example: `treadlink explain contact length`
    """
    from textwrap import wrap

    from gateway.core.errors import ConfigError
    from gateway.core.nearest_name import did_you_mean
    from gateway.glossary.entries import entries, matching

    name = " ".join(words)
    matches = matching(name)
    if not matches:
        words_known = [known_name for entry in entries() for known_name in entry.names]
        raise ConfigError(
            f"'{name}' is no quantity, effect, reason, status, column or term",
            f"{did_you_mean(name, words_known)}`treadlink explain` takes the names that screens and files have.",
        )
    if len(matches) > 3:
        for entry in matches:
            click.echo(f"{entry.word}  ({entry.kind})")
        return
    for entry in matches:
        click.echo(f"{entry.word}  ({entry.kind})")
        for label, text in entry.lines:
            head = f"  {label}:" if label else " "
            for line in wrap(text, 96, initial_indent=f"{head} ", subsequent_indent="    "):
                click.echo(line)
