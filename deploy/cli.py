"""The command `hd-deploy`: the robot side."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from common.cli import CommandApp, add_version, command_errors
from common.errors import ConfigError
from common.page.options import PageOption, TokenOption, page_settings
from common.system.logs import setup_logging
from common.tasks import NAVIGATION, find_task
from deploy.cli_options import ConfigFile, Connect, LogLevel, Overrides, Profile, RobotName, load_options
from deploy.network_cli import add_network_commands
from deploy.page.cli import announce, page
from deploy.recording.cli import app as recording_app
from deploy.robot.cli import DEMO_EXAMPLES, demo, robot
from deploy.robot.cli import EXAMPLES as ROBOT_EXAMPLES
from deploy.ros_arguments import BEGIN, translate

app = CommandApp(
    add_completion=True,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Let a robot explore, or go to a target: the bridge to ROS 2, its commands, a simulated robot.",
)

app.command(epilog=ROBOT_EXAMPLES)(robot)
app.command(epilog=DEMO_EXAMPLES)(demo)
app.command()(page)
app.add_typer(recording_app)
add_network_commands(app)
add_version(app)


@app.command()
@command_errors
def bridge(
    profile: Profile = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
    planner: Annotated[
        str | None,
        typer.Option("--planner", help="Planner, see `hd-eval planners`, or MODULE:CLASS. [default: hdplanner]"),
    ] = None,
    policy: Annotated[
        Path | None, typer.Option("--policy", help="A trained policy (.safetensors or .onnx); means hdplanner.")
    ] = None,
    goal: Annotated[
        str | None, typer.Option("--goal", help="Go to this place instead of exploring, metres.", metavar="X,Y")
    ] = None,
    autostart: Annotated[bool, typer.Option("--autostart", help="Start without a command.")] = False,
    connect: Connect = None,
    listen: Annotated[
        list[str] | None,
        typer.Option("--listen", help="Act as the robot's Zenoh router at this endpoint.", metavar="ENDPOINT"),
    ] = None,
    name: RobotName = None,
    page_at: PageOption = None,
    page_token: TokenOption = None,
    log_level: LogLevel = None,
) -> None:
    """Run the bridge on a robot's computer. Ctrl-C, or SIGTERM, stops the robot and ends it.

    Examples:
    - `hd-deploy bridge` on a robot with /scan, /odom and /cmd_vel

    - `hd-deploy bridge --profile cmu --policy office.safetensors`

    - `hd-deploy bridge --profile nav2 --planner tare --set mapping.viewpoint_spacing=1.5`

    - `hd-deploy bridge --goal 12.5,-3 --autostart`

    - `hd-deploy bridge --page 8080` shows the robot in a browser, and takes its commands
    """
    setup_logging(log_level)
    extra: list[str] = []
    if policy is not None:
        extra.append(f"decision.policy={policy}")
    if planner is not None or policy is not None:
        extra.append(f"decision.planner={planner or 'hdplanner'}")
    if goal is not None:
        extra.append(f"decision.goal={goal}")
    if autostart:
        extra.append("decision.autostart=true")
    if listen:
        extra += [f"ros.listen={','.join(listen)}", "ros.connect="]
    resolved = load_options(profile, config, overrides, connect, name, extra)
    if goal is not None and not find_task(resolved.decision.task).needs_target:
        resolved = load_options(profile, config, overrides, connect, name, [*extra, f"decision.task={NAVIGATION.name}"])
    from common.bus.endpoint import require_free

    # The bridge's own imports and kernels take seconds, on a fresh machine minutes.
    require_free(resolved.ros.listen)
    from deploy.bridge.process import run_bridge

    if page_at is None:
        run_bridge(resolved)
        return
    from deploy.page.process import start_page

    settings = page_settings(page_at, page_token)
    with start_page(settings, resolved) as shown:
        announce(shown.address, settings)
        run_bridge(resolved)


@app.command()
@command_errors
def relay(
    profile: Profile = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
    name: RobotName = None,
    listen: Annotated[
        list[str] | None,
        typer.Option(
            "--listen",
            help="Be the Zenoh router at this endpoint. [default: where the bridge connects to, ros.connect]",
            metavar="ENDPOINT",
        ),
    ] = None,
    connect: Annotated[
        list[str] | None,
        typer.Option("--connect", help="Join the Zenoh router at this endpoint instead.", metavar="ENDPOINT"),
    ] = None,
    status: Annotated[bool, typer.Option("--status", help="Print the running relay's counters as JSON.")] = False,
    log_level: LogLevel = None,
) -> None:
    """Join a robot whose ROS 2 is DDS to the bridge; needs rclpy, of a ROS 2 installation or the extra `ros2`.

    It carries the topics of the profile and the lifecycle's services, both ways, until Ctrl-C or SIGTERM.

    Examples:
    - `hd-deploy relay` next to `hd-deploy bridge`, both on the robot's computer

    - `hd-deploy relay --profile nav2 --set ros.namespace=robot1 --listen tcp/127.0.0.1:7448`

    - `hd-deploy relay --status | jq .lost`
    """
    setup_logging(log_level)
    if listen and connect:
        raise ConfigError("--listen and --connect are two ways to be on the Zenoh network: give one")
    extra = [f"ros.listen={','.join(listen)}", "ros.connect="] if listen else []
    resolved = load_options(profile, config, overrides, connect, name, extra)
    from common.bus.control import request
    from deploy.network_config import guest_of
    from deploy.relay.names import relay_name
    from deploy.relay.process import as_router, run_relay
    from deploy.ros2.session import open_session

    if status:
        guest = guest_of(resolved.ros)
        with open_session(guest) as session:
            answer = request(session, relay_name(resolved.name), "status", asked="relay")
        typer.echo(json.dumps(answer, indent=2))
        return
    run_relay(resolved if listen or connect else as_router(resolved))


@app.command()
@command_errors
def config(
    profile: Profile = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
    describe: Annotated[bool, typer.Option("--describe", help="Explain every parameter instead (Markdown).")] = False,
) -> None:
    """Print the resolved parameters as TOML, which `--config` reads back; those that follow from others as comments.

    Examples:
    - `hd-deploy config --profile nav2 > robot.toml`

    - `hd-deploy config --describe | less`
    """
    from common.config.describe import to_markdown, to_toml
    from deploy.config import DeployConfig

    if describe:
        typer.echo(to_markdown(DeployConfig))
    else:
        resolved = load_options(profile, config, overrides)
        typer.echo(to_toml(resolved, resolved.left_out))


@command_errors
def main() -> None:
    """Run `hd-deploy`; arguments as ROS 2 gives them to its nodes are understood too."""
    arguments = sys.argv[1:]
    if BEGIN in arguments:
        arguments = translate(arguments)
    app(arguments)


if __name__ == "__main__":
    main()
