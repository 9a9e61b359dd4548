"""The command `hd-deploy`: the robot side."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
import zenoh

from common.bus.control import request
from common.bus.fleet import Answers, bridges_at, command_all
from common.cli import CommandApp, add_version, command_errors, output_console, whole_table
from common.config.describe import to_markdown, to_toml
from common.errors import BusError, ConfigError
from common.page.options import PageOption, TokenOption, page_settings
from common.system.logs import setup_logging
from common.tasks import NAVIGATION, find_task
from deploy.bridge.command_text import CommandError, parse, release_of
from deploy.config import DeployConfig
from deploy.page.cli import PAGE_EXAMPLES, announce, page
from deploy.profiles import DEPLOY, load_deploy_config
from deploy.recording.cli import app as recording_app
from deploy.robot.cli import DEMO_EXAMPLES, demo, robot
from deploy.robot.cli import EXAMPLES as ROBOT_EXAMPLES
from deploy.ros_arguments import BEGIN, translate

# Seconds in which a bridge shows up that is there.
_LOOK = 2.0

app = CommandApp(
    add_completion=True,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Let a robot explore, or go to a target: the bridge to ROS 2, its commands, a simulated robot.",
)

Profile = Annotated[
    str | None,
    typer.Option(
        "--profile", help=f"Shipped parameters to build upon: {', '.join(DEPLOY.preset_names())}. [default: bare]"
    ),
]
ConfigFile = Annotated[Path | None, typer.Option("--config", help="TOML or JSON file with parameters.", metavar="FILE")]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", help="One parameter; may be repeated.", metavar="SECTION.FIELD=VALUE"),
]
Connect = Annotated[
    list[str] | None,
    typer.Option("--connect", help="Endpoint of the robot's Zenoh router. [default: ros.connect]", metavar="ENDPOINT"),
]
RobotName = Annotated[str | None, typer.Option("--name", help="Name of the robot. [default: name]")]
LogLevel = Annotated[str | None, typer.Option("--log-level", help="debug, info, warning or error.")]

app.command(epilog=ROBOT_EXAMPLES)(robot)
app.command(epilog=DEMO_EXAMPLES)(demo)
app.command(epilog=PAGE_EXAMPLES)(page)
app.add_typer(recording_app)
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
        typer.Option("--listen", help="Be the robot's Zenoh router at this endpoint.", metavar="ENDPOINT"),
    ] = None,
    name: RobotName = None,
    page_at: PageOption = None,
    page_token: TokenOption = None,
    log_level: LogLevel = None,
) -> None:
    """Run the bridge on a robot's computer. Ctrl-C, or SIGTERM, stops the robot and ends it.

    Examples:
    - `hd-deploy bridge` beside a robot with /scan, /odom and /cmd_vel

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
    resolved = _load(profile, config, overrides, connect, name, extra)
    if goal is not None and not find_task(resolved.decision.task).needs_target:
        resolved = _load(profile, config, overrides, connect, name, [*extra, f"decision.task={NAVIGATION.name}"])
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
    - `hd-deploy relay` beside `hd-deploy bridge`, both on the robot's computer

    - `hd-deploy relay --profile nav2 --set ros.namespace=robot1 --listen tcp/127.0.0.1:7448`

    - `hd-deploy relay --status | jq .lost`
    """
    setup_logging(log_level)
    if listen and connect:
        raise ConfigError("--listen and --connect are two ways to be on the Zenoh network: give one")
    extra = [f"ros.listen={','.join(listen)}", "ros.connect="] if listen else []
    resolved = _load(profile, config, overrides, connect, name, extra)
    from deploy.relay.process import as_router, run_relay
    from deploy.relay.relay import relay_name
    from deploy.ros2.session import guest_of, open_session

    if status:
        guest = guest_of(resolved.ros)
        with open_session(guest) as session:
            answer = request(session, relay_name(resolved.name), "status", asked="relay")
        typer.echo(json.dumps(answer, indent=2))
        return
    run_relay(resolved if listen or connect else as_router(resolved))


@app.command(context_settings={"ignore_unknown_options": True})
@command_errors
def command(
    words: Annotated[
        list[str],
        typer.Argument(
            help="start, pause, resume, abort, return-home, reset, goal X Y, explore, stop (emergency stop), release, "
            "status.",
            metavar="COMMAND...",
        ),
    ],
    name: RobotName = None,
    connect: Connect = None,
    profile: Profile = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
    who: Annotated[str | None, typer.Option("--who", help="Who releases the emergency stop.", metavar="NAME")] = None,
    why: Annotated[str | None, typer.Option("--why", help="Why it is safe to release it.", metavar="REASON")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the whole status as JSON.")] = False,
    timeout: Annotated[float, typer.Option("--timeout", min=0.1, help="Seconds to wait for the robot.")] = 5.0,
) -> None:
    """Command a running bridge; it acknowledges, or says why not.

    Examples:
    - `hd-deploy command start`

    - `hd-deploy command stop` stops every robot on the network, and fails unless each one says that it did

    - `hd-deploy command release --who anna --why "the hall is empty"`; the robot stands until the next `start`

    - `hd-deploy command goal 12.5 -3`; a robot that explores goes there, and on with `hd-deploy command explore`

    - `hd-deploy command status --json | jq .explored_area`
    """
    verb, arguments = parse(" ".join(words))
    if verb == "release":
        arguments = {"who": who or "", "why": why or ""}
        release_of(arguments)
    elif who or why:
        raise CommandError(f"--who and --why are for `release`, not for {verb!r}")
    from deploy.ros2.session import guest_of, open_session

    resolved = _load(profile, config, overrides, connect, name)
    where = ", ".join(guest_of(resolved.ros).connect)
    with open_session(guest_of(resolved.ros)) as session:
        if verb == "stop":
            # Without a name, a stop is meant for every robot on the network.
            answers = command_all(session, resolved.name if resolved.named else None, verb, timeout, arguments)
        else:
            _check_unique(session, resolved.name, min(timeout, _LOOK))
            try:
                status = request(session, resolved.name, verb, timeout, arguments, asked="robot")
            except BusError as error:
                raise BusError(f"{error} (asked at {where})") from None
            answers = Answers({(resolved.name, ""): status})
    states = list(answers.states.values())
    if as_json:
        typer.echo(json.dumps(states[0] if len(states) == 1 else states, indent=2))
    elif verb == "status":
        _show(states[0])
    else:
        for (robot_name, _), state in sorted(answers.states.items()):
            typer.echo(f"{robot_name}: {state['state']}: {state['reason']}")
    _check_complete(answers, resolved, where, timeout)


@app.command()
@command_errors
def topics(
    connect: Connect = None,
    profile: Profile = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
    wait: Annotated[float, typer.Option("--wait", min=0.1, help="Seconds to look around.")] = 1.5,
) -> None:
    """List the nodes and topics on the robot's network, and what the bridge still misses there.

    Example: `hd-deploy topics --profile cmu --connect tcp/192.168.1.5:7447`
    """
    from deploy.ros2.graph import watch
    from deploy.ros2.session import guest_of

    resolved = _load(profile, config, overrides, connect, None)
    graph = watch(guest_of(resolved.ros), wait)
    console = output_console()
    if not graph.nodes and not graph.endpoints:
        raise BusError(
            f"nobody shows up at {', '.join(guest_of(resolved.ros).connect)}: check the endpoint, ros.domain "
            f"({resolved.ros.domain}) and that the robot's RMW is rmw_zenoh, or a zenoh-bridge-ros2dds runs"
        )
    console.print(f"nodes: {', '.join(node.name for node in graph.nodes) or 'none'}")
    table = whole_table("topic", "type", "publishers", "subscriptions")
    found = graph.topics()
    for topic, endpoints in found.items():
        by_role = {
            role: ", ".join(sorted({each.node for each in endpoints if each.role == role}))
            for role in ("publisher", "subscription")
        }
        kinds = ", ".join(sorted({each.kind for each in endpoints}))
        table.add_row(topic, kinds, by_role["publisher"], by_role["subscription"])
    console.print(table)
    published = {topic for topic, endpoints in found.items() if any(each.role == "publisher" for each in endpoints)}
    missing = [topic for topic in _needed(resolved) if topic not in published]
    if missing:
        console.print(f"nobody publishes what the bridge needs: {', '.join(missing)}", style="yellow")


@app.command()
@command_errors
def config(
    profile: Profile = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
    describe: Annotated[bool, typer.Option("--describe", help="Explain every parameter instead (Markdown).")] = False,
) -> None:
    """Print the resolved parameters as TOML, which `--config` reads back.

    Examples:
    - `hd-deploy config --profile nav2 > robot.toml`

    - `hd-deploy config --describe | less`
    """
    if describe:
        typer.echo(to_markdown(DeployConfig))
    else:
        typer.echo(to_toml(_load(profile, config, overrides, None, None)))


def _check_unique(session: zenoh.Session, name: str, patience: float) -> None:
    """Refuse to command one of several bridges of the same name: nobody could tell which."""
    until = time.monotonic() + patience
    while not bridges_at(session, name) and time.monotonic() < until:
        time.sleep(0.05)
    # Peers find each other one after the other.
    time.sleep(0.2)
    others = bridges_at(session, name)
    if len(others) > 1:
        raise BusError(
            f"{len(others)} bridges on this network have the name {name!r}, so nobody could tell which one obeys: "
            "`hd-deploy command stop` stops them all; start each with a name of its own"
        )


def _check_complete(answers: Answers, config: DeployConfig, where: str, timeout: float) -> None:
    """Fail loudly unless everybody who was there has obeyed."""
    wrong = list(answers.refusals)
    wrong += [
        f"robot {name!r} did not answer within {timeout:g} s (instance {instance}): it may still be moving"
        for name, instance in sorted(answers.missing)
    ]
    if not answers.states and not wrong:
        who = f"no robot {config.name!r}" if config.named else "no robot"
        wrong.append(
            f"{who} answered within {timeout:g} s: check that it runs and that the endpoint is right (asked at {where})"
        )
    if wrong:
        raise BusError("; ".join(wrong))


def _load(
    profile: str | None,
    file: Path | None,
    overrides: Sequence[str] | None,
    connect: Sequence[str] | None,
    name: str | None,
    extra: Sequence[str] = (),
) -> DeployConfig:
    """Resolve the parameters; options of their own win over --set."""
    every = [*(overrides or ()), *extra]
    if connect:
        every.append(f"ros.connect={','.join(connect)}")
    if name is not None:
        every.append(f"name={name}")
    return load_deploy_config(file, every, os.environ, profile)


def _needed(config: DeployConfig) -> list[str]:
    from deploy.ros2.names import namespace, topic_name

    topics, sensing = config.topics, config.sensing
    source = {"scan": topics.scan, "points": topics.points, "grid": topics.map}[sensing.source]
    pose = topics.odometry if sensing.pose == "odometry" else topics.tf
    within = namespace(config.ros.namespace)
    return [topic_name(topic, within, topics.remap) for topic in (source, pose)]


def _show(status: dict[str, object]) -> None:
    table = whole_table("", "", show_header=False, box=None)
    for key, value in status.items():
        if value not in (None, "", {}, []):
            text = json.dumps(value, ensure_ascii=False) if isinstance(value, dict | list) else str(value)
            table.add_row(key.replace("_", " "), text)
    output_console().print(table)


@command_errors
def main() -> None:
    """Run `hd-deploy`; arguments as ROS 2 gives them to its nodes are understood too."""
    arguments = sys.argv[1:]
    if BEGIN in arguments:
        arguments = translate(arguments)
    app(arguments)


if __name__ == "__main__":
    main()
