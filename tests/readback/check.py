"""Reads every format of `overfly export` back with clients that are not ours, and compares it with the plan, waypoint by waypoint.

    python3 -m venv target/readback
    target/readback/bin/pip install -r tests/readback/requirements.txt
    target/readback/bin/python tests/readback/check.py target/release/overfly

Prints what was compared, and ends with 1 when something differs or a client is missing.
"""

import argparse
import pathlib
import sys
import tempfile


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary", type=pathlib.Path, help="the program under test")
    parser.add_argument("--keep", type=pathlib.Path, help="folder for all files, which stay there")
    arguments = parser.parse_args()
    try:
        import apps
        import flights
        import hill
        import missions
        import priors
    except ImportError as error:
        sys.exit(f"ERROR: {error}; install the clients with `pip install -r requirements.txt`")
    differences = flights.Differences()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or pathlib.Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for rig in flights.RIGS:
            print(f"{rig}:")
            flight = flights.Flight(arguments.binary.resolve(), folder.resolve(), rig)
            sorties = [(sortie["first_waypoint"], sortie["last_waypoint"]) for sortie in flight.files["sorties"]]
            whole = len(sorties) > 1 and sorties[0][0] == 0 and sorties[-1][1] == len(flight.plan["waypoints"]) - 1
            joined = all(before[1] == after[0] for before, after in zip(sorties, sorties[1:]))
            differences.check(whole and joined, f"the sorties {sorties} are not the whole flight")
            for part in (missions, apps, priors):
                part.check(flight, differences)
        print("over a hill:")
        hill.check(arguments.binary.resolve(), folder.resolve() / "hill", differences)
    if differences.found:
        sys.exit(f"{differences.found} differences")
    print("no differences")


if __name__ == "__main__":
    main()
