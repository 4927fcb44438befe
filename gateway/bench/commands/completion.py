"""`treadlink completion`: completion of commands and options in a shell."""

import click


@click.command()
@click.argument("shell", type=click.Choice(["bash", "fish", "zsh"]))
def completion(shell: str) -> None:
    """Print the completion script of SHELL.

    Write it where the shell looks for it:

    \b
    Examples:
      mkdir -p ~/.local/share/bash-completion/completions
      treadlink completion bash > \\
          ~/.local/share/bash-completion/completions/treadlink
      treadlink completion fish > ~/.config/fish/completions/treadlink.fish
      treadlink completion zsh > "${fpath[1]}/_treadlink"

    The script asks the installed treadlink, so it stays right after an update.
    """
    from click.shell_completion import get_completion_class

    from gateway.core.cli import treadlink

    completion_class = get_completion_class(shell)
    assert completion_class is not None  # click has these three
    click.echo(completion_class(treadlink, {}, "treadlink", "_TREADLINK_COMPLETE").source())
