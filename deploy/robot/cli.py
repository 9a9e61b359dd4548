"""`hd-deploy robot` and `hd-deploy demo`: a simulated robot behind the topics of a real one, alone or with a bridge."""

from __future__ import annotations

import contextlib
import functools
import json
import os
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.cli import command_errors, message_console
from common.errors import ConfigError
from common.page.options import TokenOption, page_settings
from common.system.extras import optional
from common.system.logs import setup_logging
from common.system.signals import stopping_signals
from common.tasks import TASKS
from deploy.robot import defaults

if TYPE_CHECKING:
    from deploy.config import DeployConfig
    from deploy.robot.options import RobotOptions

Position = tuple[float, float]
World = Annotated[
    str,
    typer.Option("--map", help="Map file (image or ROS YAML), folder of maps, or generator:NAME[?key=value&...]."),
]
Start = Annotated[Position | None, typer.Option(metavar="X Y", help="Start in the map file, metres, map frame.")]
Target = Annotated[Position | None, typer.Option(metavar="X Y", help="Target in the map file, metres, map frame.")]
Scale = Annotated[
    float | None,
    typer.Option(help=f"Metres per pixel of the map. [default: its set's, else {defaults.METRES_PER_PIXEL}]"),
]
# What a simulated robot takes, all at once, whichever is missed first.
_EXTRAS = ("actor", "pybullet", "robot", "plots")

EXAMPLES = """
Examples:

  hd-deploy robot                                   a small office, ROS 2 topics of the profile `bare`

  hd-deploy robot --profile cmu --map hall.png      the CMU stack's topics; drives to /way_point itself

  hd-deploy robot --map floor.yaml --start 2.5 -1   a map of ROS; metres in its own frame

  hd-deploy robot --map "generator:forest?seed=7" --speed-factor 3 --range-noise 0.02

  hd-deploy robot --connect tcp/10.0.0.5:7447       join the rmw_zenohd router of a ROS 2 system
"""

DEMO_EXAMPLES = """
Examples:

  hd-deploy demo                                    a small office, explored by the bridge that drives itself

  hd-deploy demo --task navigation --profile cmu    to a target, on a robot that drives to waypoints itself

  hd-deploy demo --map floorplans:plan.png          a floor plan with a yellow start, 0.1 m a pixel

  hd-deploy demo --map "generator:forest?width=256&height=192" --planner tare --video forest.gif
"""


@command_errors
def robot(
    world: World = defaults.MAP,
    start: Start = None,
    target: Target = None,
    profile: Annotated[str | None, typer.Option(help="Topics and frames: bare, cmu or nav2. [default: bare]")] = None,
    config: Annotated[Path | None, typer.Option(help="TOML or JSON file, the bridge's own.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="A parameter, as for the bridge.")
    ] = None,
    connect: Annotated[
        list[str] | None, typer.Option(help="Join the router at this endpoint instead of being one.")
    ] = None,
    listen: Annotated[
        list[str] | None, typer.Option(help="Be the router at this endpoint. [default: where the bridge connects to]")
    ] = None,
    metres_per_pixel: Scale = None,
    seed: Annotated[int, typer.Option(help="Number of the world in its source, and seed of all noise.")] = 0,
    speed_factor: Annotated[float, typer.Option(help="Times faster than real time.")] = 1.0,
    layers: Annotated[
        int | None, typer.Option(help="Lidar layers, 1 or 16. [default: 16 where the profile has point clouds]")
    ] = None,
    rays: Annotated[int, typer.Option(help="Beams of a turn.")] = defaults.RAYS,
    scan_rate: Annotated[float, typer.Option(help="Scans per second, Hz.")] = defaults.SCAN_RATE,
    people: Annotated[int, typer.Option(help="People who walk about; they stop before the robot.")] = 0,
    odometry_rate: Annotated[float, typer.Option(help="Odometry messages per second, Hz.")] = defaults.ODOMETRY_RATE,
    map_rate: Annotated[float, typer.Option(help="Grids of its own mapping per second, Hz.")] = defaults.MAP_RATE,
    range_noise: Annotated[float, typer.Option(help="Standard deviation of ranges, m.")] = 0.0,
    odometry_drift: Annotated[float, typer.Option(help="Error of odometry, m per m and rad per square root of m.")] = 0,
    sensor_latency: Annotated[float, typer.Option(help="Delay of sensor messages, s.")] = 0.0,
    command_latency: Annotated[float, typer.Option(help="Delay of commands, s.")] = 0.0,
    max_speed: Annotated[float, typer.Option(help="Maximum speed of the base, m/s.")] = defaults.MAX_SPEED,
    max_turn_rate: Annotated[float, typer.Option(help="Its maximum turn rate, rad/s.")] = defaults.MAX_TURN_RATE,
    acceleration: Annotated[float, typer.Option(help="How fast it gains speed, m/s2.")] = defaults.ACCELERATION,
    deceleration: Annotated[float, typer.Option(help="How fast it brakes, m/s2.")] = defaults.DECELERATION,
    turn_acceleration: Annotated[float, typer.Option(help="Of turns, rad/s2.")] = defaults.TURN_ACCELERATION,
    command_timeout: Annotated[
        float, typer.Option(help="The base stops after this time without velocities, s.")
    ] = defaults.COMMAND_TIMEOUT,
    follow: Annotated[
        bool | None,
        typer.Option(
            "--follow/--no-follow",
            help="Drive to waypoints itself. [default: where the profile's bridge does not drive]",
        ),
    ] = None,
    seconds: Annotated[float | None, typer.Option(help="End after so many seconds of the robot.")] = None,
    log_level: Annotated[str | None, typer.Option(help="debug, info, warning or error.")] = None,
) -> None:
    """Simulate a robot under physics behind the ROS 2 topics of a real one. Ctrl-C ends it."""
    setup_logging(log_level)
    from common.bus.endpoint import require_free
    from deploy.profiles import load_deploy_config

    resolved = robot_config(load_deploy_config(config, settings or (), os.environ, profile), connect, listen)
    # Before the physics and what else is imported for seconds.
    require_free(resolved.ros.listen)
    with optional("hd-deploy robot", *_EXTRAS):
        from deploy.robot.process import run_robot

    options = checked_options(
        {
            "map": placed(world, start, target),
            "metres_per_pixel": metres_per_pixel,
            "seed": seed,
            "speed_factor": speed_factor,
            "layers": layers,
            "rays": rays,
            "scan_rate": scan_rate,
            "people": people,
            "odometry_rate": odometry_rate,
            "map_rate": map_rate,
            "range_noise": range_noise,
            "odometry_drift": odometry_drift,
            "sensor_latency": sensor_latency,
            "command_latency": command_latency,
            "max_speed": max_speed,
            "max_turn_rate": max_turn_rate,
            "acceleration": acceleration,
            "deceleration": deceleration,
            "turn_acceleration": turn_acceleration,
            "command_timeout": command_timeout,
            "follow": follow,
        }
    )
    stop = threading.Event()
    with stopping_signals(stop.set, stop.is_set):
        run_robot(options, resolved, stop, seconds)


@command_errors
def demo(
    task: Annotated[str, typer.Option(help="exploration, navigation, or MODULE:NAME.")] = "exploration",
    planner: Annotated[str, typer.Option(help="Planner or MODULE:CLASS; hdplanner: shipped policy.")] = "hdplanner",
    world: World = defaults.MAP,
    start: Start = None,
    target: Target = None,
    metres_per_pixel: Scale = None,
    seed: Annotated[int, typer.Option(help="Number of the world in its source, and seed of all noise.")] = 0,
    profile: Annotated[str, typer.Option(help="Topics and frames: bare, cmu or nav2.")] = "bare",
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="A parameter of robot and bridge.")
    ] = None,
    speed_factor: Annotated[float, typer.Option(help="Times faster than real time.")] = 1.0,
    people: Annotated[int, typer.Option(help="People who walk about; they stop before the robot.")] = 0,
    range_noise: Annotated[float, typer.Option(help="Standard deviation of ranges, m.")] = 0.02,
    limit: Annotated[
        float | None, typer.Option(help="End after so many seconds of the robot. [default: ample for the world]")
    ] = None,
    folder: Annotated[Path, typer.Option(help="Where video, verdict and logs go.")] = Path("runs/demo"),
    video: Annotated[str, typer.Option(help="Name of the video, .mp4 or .gif; empty for none.")] = "demo.mp4",
    page_at: Annotated[
        str | None,
        typer.Option(
            "--page",
            help="Where to show it in a browser; empty for no page. [default: 8080, or a free port]",
            metavar="[HOST:]PORT",
        ),
    ] = None,
    page_token: TokenOption = None,
    log_level: Annotated[str | None, typer.Option(help="debug, info, warning or error.")] = None,
) -> None:
    """Watch a simulated robot explore: live in the terminal and in a browser, a video at the end."""
    console = message_console()
    setup_logging(log_level, console=console if console.is_terminal else None)
    with optional("hd-deploy demo", *_EXTRAS):
        from deploy.robot.demo import DEFAULT_PAGE, demo_page, run_demo
        from deploy.robot.trial import Trial

    TASKS.check(task)
    world = placed(world, start, target)
    options = checked_options(
        {
            "map": world,
            "metres_per_pixel": metres_per_pixel,
            "seed": seed,
            "speed_factor": speed_factor,
            "people": people,
            "range_noise": range_noise,
        }
    )
    trial = Trial(
        task,
        options=options,
        planner=planner,
        profile=profile,
        folder=folder,
        settings=[*suited_settings(world), *(settings or ())],
    )
    stop = threading.Event()
    seconds = trial.ample_seconds if limit is None else limit
    page = None if page_at == "" else page_settings(page_at or DEFAULT_PAGE, page_token)
    shown = contextlib.nullcontext if page is None else functools.partial(demo_page, page, insist=page_at is not None)
    with stopping_signals(stop.set, stop.is_set):
        verdict = run_demo(trial, folder, seconds, stop, console, video or None, shown)
    typer.echo(json.dumps(verdict.to_json(), indent=2))
    if not verdict.success and not stop.is_set():
        raise typer.Exit(1)


def placed(world: str, start: Position | None, target: Position | None) -> str:
    """Return a world with the start and the target of the command line put in."""
    if start is None and target is None:
        return world
    from actors.maps.spec import with_places

    return with_places([world], start, target)[0]


def suited_settings(world: str) -> list[str]:
    """Return the mapping settings recommended for a world, as overrides for robot and bridge.

    How much room the robot needs is a matter of the robot, and not of its world.
    """
    from actors.maps.sources import recommended

    return [
        f"{path}={json.dumps(value)}"
        for path, value in recommended(world).settings.items()
        if path.startswith("mapping.") and path != "mapping.robot_radius"
    ]


def checked_options(values: dict[str, object]) -> RobotOptions:
    """Validate options; `ConfigError` names the first wrong one as the command line spells it."""
    from pydantic import ValidationError

    from common.problems import first_problem
    from deploy.robot.options import RobotOptions

    try:
        return RobotOptions.model_validate(values)
    except ValidationError as error:
        problem = first_problem(error)
        option = "--" + problem.path.replace("_", "-")
        raise ConfigError(f"{option}: {problem.words}, got {problem.given!r}") from None


def robot_config(config: DeployConfig, connect: list[str] | None, listen: list[str] | None) -> DeployConfig:
    """Return the bridge's configuration as the robot uses it: it is the router, unless it is to join one.

    Without either option it listens where the bridge connects to, or joins the bridge where that listens.

    Raises:
        ConfigError: both are given, an endpoint is none, or neither is given and the bridge connects elsewhere.
    """
    if connect and listen:
        raise ConfigError("--connect joins a router and --listen is one: give one of the two")
    if not connect and not listen:
        from deploy.network_config import router_for_bridge

        return config.model_copy(update={"ros": router_for_bridge(config.ros, "the simulated robot")})
    from pydantic import ValidationError

    from common.problems import first_problem
    from deploy.network_config import RosConfig

    endpoints = {"connect": connect or (), "listen": listen or ()}
    try:
        ros = RosConfig.model_validate({**config.ros.model_dump(exclude_unset=True), **endpoints})
    except ValidationError as error:
        problem = first_problem(error)
        option = "--connect" if connect else "--listen"
        raise ConfigError(f"{option}: {problem.words}, got {problem.given!r}") from None
    return config.model_copy(update={"ros": ros})
