"""How long a diagnosis takes: python -m tests.benchmarks.diagnosis_speed [--rate 20] [--hours 0.25] [--without-wheel]

Made logs of the first reference (its programme of sixteen runs, a quarter of an hour, as often as the hours ask for)
with nothing hidden and with a clear steering offset are diagnosed once the code is compiled. Printed are seconds of CPU
against minutes of log, the names, and the largest memory of the process. Without arguments the two cases that are asked
are run: with a wheel angle at 20 Hz and without one; `--hours 8 --rate 10` is a day, `--one-run` one without a stop.
"""

import argparse
import resource
import time

from tests.truth.drives import Drive, circles, default_programme, drive, stairs, straight
from tests.truth.model import Truth
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.model.tractor import load_tractor

PROGRAMME_H = 0.26
HIDDEN: tuple[dict[str, dict[str, float]], ...] = ({}, {"steering_offset": {"angle_deg": 1.5}})


def logs(effects: dict[str, dict[str, float]], drives: list[Drive], rate_hz: float, wheel: bool) -> list[Log]:
    """Logs of drives, with or without a measured wheel angle."""
    drop = () if wheel else ("steering_deg",)
    truth = Truth(effects, 31, rate_hz=rate_hz)
    frames = [(drive.name, truth.log(drive, index).drop(columns=list(drop))) for index, drive in enumerate(drives)]
    return [build_log(frame, f"{index} {name}") for index, (name, frame) in enumerate(frames)]


def one_run(hours: float) -> Drive:
    """Rows and turns to either side without a stop, at changing speeds."""
    lap = [(40.0, 0.0), (12.0, 24.0), (40.0, 0.0), (12.0, -24.0), (10.0, 4.0), (10.0, -4.0)]
    count = max(1, round(hours * 3600.0 / sum(seconds for seconds, _ in lap)))
    paces = [(300.0, pace) for pace in (1.2, 1.6, 2.0)] * max(1, round(hours * 4.0))
    return drive("one run", hours * 3600.0, stairs(*lap * count), stairs(*paces))


def measure(hours: float, rate_hz: float, wheel: bool, whole: bool) -> None:
    """Diagnose and print."""
    drives = [one_run(hours)] if whole else default_programme() * max(1, round(hours / PROGRAMME_H))
    tractor = load_tractor("eg105")
    diagnose_logs(logs({}, [straight(60.0, seconds=30.0), circles(1)], 10.0, wheel), tractor, "soil")
    for effects in HIDDEN:
        data = logs(effects, drives, rate_hz, wheel)
        start = time.process_time()
        answer = diagnose_logs(data, tractor, "soil")
        seconds = time.process_time() - start
        memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        print(
            f"{answer.minutes:6.1f} min at {rate_hz:g} Hz {'with' if wheel else 'without'} wheel angle, "
            f"{', '.join(effects) or 'nothing'} hidden: {seconds:6.1f} s of CPU, {memory_mb:.0f} MB, "
            f"named {', '.join(answer.named) or 'nothing'}",
            flush=True,
        )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rate", type=float, default=20.0, help="rows a second")
    parser.add_argument("--hours", type=float, default=0.25, help="length of the logs together")
    parser.add_argument("--without-wheel", action="store_true", help="only logs without a measured wheel angle")
    parser.add_argument("--one-run", action="store_true", help="all hours in one log without a stop")
    given = parser.parse_args()
    for wheel in (False,) if given.without_wheel else (True, False) if given.hours < 1.0 else (True,):
        measure(given.hours, given.rate, wheel, given.one_run)


if __name__ == "__main__":
    main()
