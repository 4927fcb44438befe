"""Group of commands that refuses a removed command or option with what replaces it."""

from typing import Any

import click

from gateway.core.removed_names import replacement


class CommandGroup(click.Group):
    """Group whose commands and options that earlier versions had are refused with their replacement."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the subcommand."""
        remedy = replacement(ctx.command_path, args[0])
        if remedy is not None and self.get_command(ctx, args[0]) is None:
            ctx.fail(f"'{ctx.command_path} {args[0]}' was removed. {remedy}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the subcommand."""
        try:
            return super().invoke(ctx)
        except click.NoSuchOption as error:
            command = error.ctx.command_path if error.ctx is not None else ""
            remedy = replacement(command, error.option_name)
            if remedy is None:
                raise
            raise click.UsageError(f"'{error.option_name}' was removed. {remedy}", error.ctx) from error
