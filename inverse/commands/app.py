"""The command line's table of contents."""

from typing import Annotated, Any

import typer
from rich.markup import escape
from typer.core import TyperGroup

import arfjax
from arfjax import InputError
from inverse.commands.calibrate import calibrate
from inverse.commands.causes import causes_command
from inverse.commands.design import design_command
from inverse.commands.diagnose import diagnose_command
from inverse.commands.field import field_command
from inverse.commands.fit_dma import fit_dma
from inverse.commands.fit_heating import fit_heating_command
from inverse.commands.infer import infer_command
from inverse.commands.monitor import monitor_command
from inverse.commands.push import push_command
from inverse.commands.reproduce import reproduce
from inverse.commands.simulate import simulate
from inverse.commands.sonicate import sonicate_command
from inverse.commands.vary import vary_command
from inverse.commands.vibrate import vibrate_command
from inverse.datasets.shipped import shipped, shipped_names


class _Commands(TyperGroup):
    """Commands whose help is shown as it is written, and which refuse a second value where one is taken.

    Rich would take "[degC]" in a help for markup, and leave it out.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for command in self.commands.values():
            said: list[Any] = [command, *command.params]
            for each in said:
                if getattr(each, "help", None):
                    each.help = escape(each.help)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that is asked for; of an option given twice its parser would keep the last value alone."""
        name, command, rest = super().resolve_command(ctx, args)
        if command is not None:
            inside: Any = command.context_class(command, info_name=name, parent=ctx)
            _, _, given = command.make_parser(inside).parse_args(args=list(rest))
            _require_once([one for one in given if one.param_type_name == "option"])
        return name, command, rest


def _require_once(given: list[Any]) -> None:
    for option in given:
        times = given.count(option)
        if times > 1 and not option.multiple and not option.is_flag:
            raise InputError(f"{option.opts[0]} is given {times} times and takes one value: give it once.")


app = typer.Typer(
    name="arfjax",
    cls=_Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Simulate, calibrate and diagnose how radiation force moves tissue that focused ultrasound heats.",
)
app.command()(simulate)
app.command("field")(field_command)
app.command("push")(push_command)
app.command("vibrate")(vibrate_command)
app.command("sonicate")(sonicate_command)
app.command("monitor")(monitor_command)
app.command("vary")(vary_command)
app.command()(calibrate)
app.command("fit-dma")(fit_dma)
app.command("diagnose")(diagnose_command)
app.command("design")(design_command)
app.command("causes")(causes_command)
app.command("infer")(infer_command)
app.command("fit-heating")(fit_heating_command)
app.command()(reproduce)


@app.command()
def data(name: Annotated[str, typer.Argument(help="Name of a shipped data set; none lists them.")] = "") -> None:
    """Print the path of a real measurement that comes with the package."""
    typer.echo("\n".join(shipped_names()) if not name else str(shipped(name)))


@app.command()
def version() -> None:
    """Print the version."""
    typer.echo(arfjax.__version__)
