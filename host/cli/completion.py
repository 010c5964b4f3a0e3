"""`palpate completion`: the shell's half of completing commands with the Tab key."""

from __future__ import annotations

import click

from palpate.errors import PalpateError


@click.command("completion")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def command(ctx: click.Context, shell: str) -> None:
    """Print the completion script of a shell.

    \b
    Example:
      palpate completion bash > ~/.local/share/bash-completion/completions/palpate
      palpate completion zsh > ~/.zfunc/_palpate
      palpate completion fish > ~/.config/fish/completions/palpate.fish
    """
    from click.shell_completion import get_completion_class

    found = get_completion_class(shell)
    root = ctx.find_root()
    if found is None:
        raise PalpateError(f"this version of click cannot complete for {shell}; update it")
    click.echo(found(root.command, {}, "palpate", "_PALPATE_COMPLETE").source())
