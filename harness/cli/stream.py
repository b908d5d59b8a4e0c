"""The command `serve`: the loop of an experiment in real time, over UDP."""

import math
import sys
from typing import Annotated

from gough_stewart.harness.cli.command import clear_errors, wrong_use_if
from gough_stewart.harness.cli.options import ExperimentArgument, SetOption, chosen_experiment, option
from gough_stewart.harness.cli.terminal import Terminal, preparing
from gough_stewart.harness.errors import ExportError, MissedError, UsageError


def serve_command(
    experiment: ExperimentArgument,
    udp: Annotated[int, option("The port to listen on; 0 is any that is free.", "PORT", "--udp", min=0, max=65535)],
    settings: SetOption = None,
    host: Annotated[str, option("The address to listen on; 0.0.0.0 opens it to the network.", "HOST")] = "127.0.0.1",
    rate: Annotated[float, option("Rows a second, at most 250.", "HZ")] = 100.0,
    binary: Annotated[bool, option("Fixed binary rows instead of JSON.", None, "--binary")] = False,
    silence: Annotated[float, option("A sender that is silent for this long is lost.", "SECONDS")] = 1.0,
    stop: Annotated[bool, option("End when the sender is lost; else its pose holds.", None, "--stop")] = False,
    duration: Annotated[float, option("End after this time. Default: at Ctrl-C.", "SECONDS", min=0)] = math.inf,
) -> None:
    """Run the loop of an experiment in real time, for games, displays and motion software: poses out and in, over UDP.

    A datagram, also an empty one, asks for rows for 10 s; one with a pose is where the platform is to go, by a filter
    with limits of speed and acceleration. Ends at Ctrl-C or SIGTERM and says what came and went.

    Examples
    --------
    - `gough-stewart serve heave_step --udp 9750`

    - `gough-stewart serve mine.toml --udp 9750 --binary --rate 250 --stop`
    """
    with clear_errors():
        with preparing():
            from gough_stewart.harness.export.stream import Stream

            chosen = chosen_experiment(experiment, settings, executed=lambda _chosen: ())
            try:
                with wrong_use_if(ExportError):
                    stream = Stream(chosen, (host, udp), rate, binary, silence, stop)
            except OSError as error:
                raise UsageError(f"--udp {udp}, --host {host}: {error.strerror or error}; choose others") from error
        Terminal().say(f"Listening on {host}:{stream.port}, UDP. Ctrl-C ends it.")
        sys.stdout.flush()  # a program that has started this one waits for it
        tally = stream.run(duration)
        Terminal().say(
            f"{tally.time:.1f} s simulated: {tally.rows} rows out, {tally.packets} packets in, {tally.malformed} "
            f"malformed, {tally.out_of_reach} out of reach, {tally.late} late rows, "
            f"{tally.losses} losses of the sender."
        )
        if tally.ended:
            raise MissedError(f"the loop ended at {tally.time:.3f} s: {tally.ended}")
