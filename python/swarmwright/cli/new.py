"""`swarmwright new`: a commented experiment file to start from."""

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._output import print_document


class _MissionOption(click.Option):
    """An option whose help lists the missions, which the engine knows."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Return the option and its help."""
        from swarmwright.cli import templates

        record = super().get_help_record(ctx)
        return record and (record[0], f"{record[1]} {', '.join(templates.missions())}.")


@click.command(
    "new",
    cls=Command,
    example="swarmwright new minisim > my.yaml\nswarmwright new emergency_exit > exit.yaml\n"
    "swarmwright new arena --mission foraging > swarm.yaml",
)
@click.argument("template", metavar="NAME")
@click.option(
    "--mission",
    cls=_MissionOption,
    metavar="MISSION",
    help="For arena: the mission. Default: aggregation. Available:",
)
@click.option(
    "--mission-file",
    is_flag=True,
    help="For arena: print the mission as a file to customize. An experiment refers to it by `parameters: "
    "{mission: FILE.yaml}`.",
)
def command(template: str, mission: str | None, mission_file: bool) -> None:
    """Print a commented experiment file to start from.

    NAME is the template: arena, emergency_exit or minisim. The templates arena-argos, arena-enki,
    arena-gazebo, arena-gz, arena-mujoco and arena-stage run the arena's missions in another simulator, whose
    servers are on a broker.
    """
    from swarmwright import InputError
    from swarmwright.cli import templates

    of_arena = template == "arena" or template in templates.simulators()
    if not of_arena and (mission is not None or mission_file):
        raise click.UsageError(f"--mission{'-file' * mission_file} is for arena only, not for {template}")
    try:
        if mission_file:
            print_document(templates.mission(mission or "aggregation"))
        elif mission is not None:
            print_document(templates.arena(mission, template))
        else:
            print_document(templates.text(template))
    except InputError as error:
        raise click.UsageError(str(error)) from error
