from click.testing import CliRunner

from gateway.cli import treadlink


def run(*arguments: object) -> str:
    """Run a command and return what it prints."""
    result = CliRunner().invoke(treadlink, [str(argument) for argument in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output
