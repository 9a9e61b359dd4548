"""The commands of `hd-deploy` that reach robots over their network: `command` and `topics`."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Annotated

import typer

from common.cli import command_errors, output_console, whole_table
from common.errors import BusError
from common.system.steady_time import LONGEST_WAIT
from deploy.cli_options import ConfigFile, Connect, Overrides, Profile, RobotName, load_options

if TYPE_CHECKING:
    import zenoh

    from common.bus.fleet import Answers
    from deploy.config import DeployConfig

# Seconds in which a bridge shows up that is there.
_LOOK = 2.0


def add_network_commands(app: typer.Typer) -> None:
    """Add command and topics to the command line."""
    app.command(context_settings={"ignore_unknown_options": True})(command)
    app.command()(topics)


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
    timeout: Annotated[
        float, typer.Option("--timeout", min=0.1, max=LONGEST_WAIT, help="Seconds to wait for the robot.")
    ] = 5.0,
) -> None:
    """Send a command to a running bridge, and print its acknowledgement or its reason to refuse.

    Examples:
    - `hd-deploy command start`

    - `hd-deploy command stop` stops every robot on the network, and fails unless each one confirms it

    - `hd-deploy command release --who anna --why "the hall is empty"`; the robot stands until the next `start`

    - `hd-deploy command goal 12.5 -3`; a robot that explores goes there, and on with `hd-deploy command explore`

    - `hd-deploy command status --json | jq .explored_area`
    """
    from deploy.bridge.command_text import CommandError, parse, release_of

    verb, arguments = parse(" ".join(words))
    if verb == "release":
        arguments = {"who": who or "", "why": why or ""}
        release_of(arguments)
    elif who or why:
        raise CommandError(f"--who and --why are for `release`, not for {verb!r}")
    from common.bus.control import request
    from common.bus.fleet import Answers, command_all
    from deploy.network_config import guest_of
    from deploy.ros2.session import open_session

    resolved = load_options(profile, config, overrides, connect, name)
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


@command_errors
def topics(
    connect: Connect = None,
    profile: Profile = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
    wait: Annotated[float, typer.Option("--wait", min=0.1, max=LONGEST_WAIT, help="Seconds to listen.")] = 1.5,
) -> None:
    """List the nodes and topics on the robot's network, and which ones the bridge still needs.

    Behind a relay these are the topics that others publish in DDS.

    Example: `hd-deploy topics --profile cmu --connect tcp/192.168.1.5:7447`
    """
    from deploy.bridge.type_watch import type_problem
    from deploy.needs import needs_of
    from deploy.network_config import guest_of
    from deploy.relay.names import node_of_relay
    from deploy.ros2.graph import watch
    from deploy.routes import named_routes

    resolved = load_options(profile, config, overrides, connect)
    guest = guest_of(resolved.ros)
    graph = watch(guest, wait)
    relay = node_of_relay(resolved.ros)
    in_dds: dict[str, list[str]] = {}
    problems: list[str] = []
    if any(node.name == relay for node in graph.nodes):
        in_dds, problems = _told_by_relay(resolved)
    console = output_console()
    if not graph.nodes and not graph.endpoints:
        if graph.elsewhere:
            raise BusError(
                f"no ROS 2 node found in domain {resolved.ros.domain}, but in {', '.join(map(str, graph.elsewhere))}: "
                f"set ros.domain={graph.elsewhere[0]}, because ROS_DOMAIN_ID is not read here, or give the nodes the "
                "same domain"
            )
        raise BusError(
            f"no ROS 2 node found at {', '.join(guest.connect)}: check the endpoint, ros.domain "
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
    # What a relay publishes here is published only if somebody does so in DDS.
    kinds_of = {
        topic: {each.kind for each in endpoints if each.role == "publisher" and each.node != relay}
        for topic, endpoints in found.items()
    }
    for topic, names in in_dds.items():
        kinds_of[topic] = kinds_of.get(topic, set()) | set(names)
    if in_dds:
        listed = "".join(f"\n  {topic}: {', '.join(names)}" for topic, names in in_dds.items())
        console.print(f"published in DDS, behind {relay}:{listed}", highlight=False)
    for problem in problems:
        console.print(f"the relay says: {problem}", style="yellow", highlight=False)
    routes = named_routes(resolved)
    for problem in dict.fromkeys(type_problem(resolved, routes, each) for each in graph.endpoints):
        if problem:
            console.print(problem, style="yellow", highlight=False)
    missing = [need for need in needs_of(resolved) if need.kind not in kinds_of.get(need.topic, ())]
    if missing:
        listed = ", ".join(need.topic or f"(no topic in topics.{need.name})" for need in missing)
        console.print(f"not published, but needed by the bridge: {listed}", style="yellow")
    for need in missing:
        # Another name, or another namespace, is the most frequent reason.
        others = [topic for topic, names in kinds_of.items() if need.kind in names]
        if others:
            there = f"{need.kind} is published on {', '.join(others)}"
            console.print(f"{there}: --set topics.{need.name}={others[0]}", style="yellow")


def _told_by_relay(config: DeployConfig) -> tuple[dict[str, list[str]], list[str]]:
    """Return what others publish in DDS, types by topic, and what the relay finds wrong there."""
    from common.bus.control import request
    from deploy.network_config import guest_of
    from deploy.relay.names import relay_name
    from deploy.ros2.session import open_session

    try:
        with open_session(guest_of(config.ros)) as session:
            told = request(session, relay_name(config.name), "status", asked="relay")
    except BusError as error:
        return {}, [f"nothing: {error}"]
    return told["published_in_dds"], told["problems"]


def _check_unique(session: zenoh.Session, name: str, patience: float) -> None:
    """Refuse to command one of several bridges with the same name: it would be ambiguous."""
    from common.bus.fleet import bridges_at

    until = time.monotonic() + patience
    while not bridges_at(session, name) and time.monotonic() < until:
        time.sleep(0.05)
    # Peers find each other one after the other.
    time.sleep(0.2)
    others = bridges_at(session, name)
    if len(others) > 1:
        raise BusError(
            f"{len(others)} bridges on this network have the name {name!r}, so it is ambiguous which one would obey: "
            "`hd-deploy command stop` stops them all; start each with a unique name"
        )


def _check_complete(answers: Answers, config: DeployConfig, where: str, timeout: float) -> None:
    """Fail unless every bridge that was there has obeyed."""
    wrong = answers.problems(timeout)
    if not answers.states and not wrong:
        who = f"no robot {config.name!r}" if config.named else "no robot"
        wrong.append(
            f"{who} answered within {timeout:g} s: check that it runs and that the endpoint is right (asked at {where})"
        )
    if wrong:
        raise BusError("; ".join(wrong))


def _show(status: dict[str, object]) -> None:
    table = whole_table("", "", show_header=False, box=None)
    for key, value in status.items():
        if value not in (None, "", {}, []):
            text = json.dumps(value, ensure_ascii=False) if isinstance(value, dict | list) else str(value)
            table.add_row(key.replace("_", " "), text)
    output_console().print(table)
