"""The installed TORCS, and how it is started without rights and without a display.

Each TORCS runs in a private tree of links to the installed one, to which a car of our own, a robot and a race are
added. It is removed afterwards.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from string import Template

import gymnasium

HERE = Path(__file__).parent
OWN_CAR = "gt1"
"""The car that comes with this package, ``gt1.xml``."""
SETUP = "bash scripts/build_torcs.sh (without a checkout: python -m dpsearch.envs.torcs)"

_LIBRARIES = ("/usr/lib/*/torcs", "/usr/lib/torcs", "/usr/local/lib/torcs")
_DATA = ("/usr/share/games/torcs", "/usr/local/share/games/torcs")

_RACE = Template("""\
<?xml version="1.0" encoding="UTF-8"?>
<params name="race" type="param" mode="mw">
  <section name="Header"><attstr name="name" val="race"/></section>
  <section name="Tracks">
    <attnum name="maximum number" val="1"/>
    <section name="1"><attstr name="name" val="$track"/><attstr name="category" val="$category"/></section>
  </section>
  <section name="Races"><section name="1"><attstr name="name" val="race"/></section></section>
  <section name="race">
    <attnum name="laps" val="$laps"/>
    <attstr name="type" val="practice"/>
    <attstr name="starting order" val="drivers list"/>
    <attstr name="restart" val="no"/>
    <attnum name="maximum dammage" val="0"/>
    <attnum name="damage factor" min="0" max="5" val="0"/>
    <attnum name="fuel consumption factor" min="0" max="5" val="0"/>
    <section name="Starting Grid">
      <attnum name="rows" val="1"/>
      <attnum name="distance to start" val="25"/>
      <attnum name="distance between columns" val="20"/>
      <attnum name="offset within a column" val="10"/>
      <attnum name="initial speed" unit="km/h" val="0"/>
      <attnum name="initial height" val="0.2"/>
    </section>
  </section>
  <section name="Drivers">
    <attnum name="maximum number" val="1"/>
    <section name="1"><attnum name="idx" val="$index"/><attstr name="module" val="$robot"/></section>
  </section>
</params>
""")

_ROBOT = Template("""\
<?xml version="1.0" encoding="UTF-8"?>
<params name="$robot" type="robotdef">
  <section name="Robots"><section name="index"><section name="$index">
    <attstr name="name" val="$robot"/>
    <attstr name="car name" val="$car"/>
    <attnum name="race number" val="1"/>
    <attstr name="type" val="robot"/>
    <attstr name="skill level" val="pro"/>
  </section></section></section>
</params>
""")


class TorcsError(gymnasium.error.Error, OSError):
    """TORCS is missing, cannot be started, or has ended; the program that uses it is not at fault."""


def _robot() -> Path:
    """Path of our compiled robot; ``build.sh`` writes it there."""
    home = os.environ.get("XDG_CACHE_HOME")
    cache = (Path(home) if home else Path.home() / ".cache") / "dpsearch" / "torcs"
    sources = [path for suffix in ("cpp", "hpp") for path in sorted((HERE / "robot").glob(f"*.{suffix}"))]
    text = b"".join(path.read_bytes() for path in [*sources, HERE / "robot" / "plib" / "sg.h"])
    return cache / f"lockstep-{hashlib.sha256(text).hexdigest()[:16]}.so"


@dataclass(frozen=True)
class Installation:
    """The parts of an installed TORCS.

    Attributes:
        library: The directory with ``torcs-bin`` and its modules.
        data: The directory with cars and tracks.
        robot: The compiled module of our robot.
    """

    library: Path
    data: Path
    robot: Path

    @classmethod
    def find(cls) -> Installation:
        """The installation on this machine.

        Raises:
            TorcsError: If a part is missing.
        """
        libraries = [path for pattern in _LIBRARIES for path in Path("/").glob(pattern[1:])]
        library = next((path for path in libraries if (path / "torcs-bin").is_file()), None)
        data = next((path for path in map(Path, _DATA) if (path / "tracks").is_dir()), None)
        if library is None or data is None:
            raise TorcsError(f"TORCS is not installed: run {SETUP}")
        robot = _robot()
        if not robot.is_file():
            raise TorcsError(f"TORCS is installed, but our robot for it, {robot}, is missing: run {SETUP}")
        return cls(library, data, robot)

    def cars(self) -> list[str]:
        """The names of all cars."""
        shipped = (path.name for path in (self.data / "cars").iterdir() if (path / f"{path.name}.xml").is_file())
        return sorted({OWN_CAR, *shipped})

    def tracks(self) -> dict[str, str]:
        """The names of all tracks, and the category of each."""
        files = (self.data / "tracks").glob("*/*/*.xml")
        return {path.stem: path.parent.parent.name for path in sorted(files) if path.stem == path.parent.name}

    def drivers(self) -> list[str]:
        """The names of TORCS' own drivers, human ones left out."""
        return sorted(path.name for path in (self.library / "drivers").iterdir() if path.name != "human")

    def check(self, track: str, car: str) -> None:
        """Makes sure that the race's track and car exist.

        Raises:
            ValueError: If there is no such track or car.
        """
        for kind, name, known in (("track", track, sorted(self.tracks())), ("car", car, self.cars())):
            if name not in known:
                raise ValueError(f"{kind} must be one of {', '.join(known)}, got {name!r}")


@dataclass(frozen=True)
class Race:
    """A race of one car on one track.

    Attributes:
        track: Name of the track.
        car: Name of the car.
        robot: Name of the driver, our own "lockstep" or one of TORCS' own.
        index: Number of the driver, among the drivers of that name.
        laps: Number of laps after which the race ends.
    """

    track: str
    car: str
    robot: str = "lockstep"
    index: int = 1
    laps: int = 10_000


class Stage:
    """A private tree of links in which TORCS runs a race.

    Args:
        installation: The installation that the links lead to.
        race: The race to run.

    Attributes:
        root: The directory that holds all of it; ``remove`` deletes it.
        command: Command that starts TORCS in ``root``.
        environment: Environment variables of that command.

    Raises:
        ValueError: If there is no such track or car.
    """

    def __init__(self, installation: Installation, race: Race) -> None:
        installation.check(race.track, race.car)
        parent = tempfile.gettempdir()
        self.root = Path(tempfile.mkdtemp(prefix="dpsearch-torcs-", dir="/tmp" if " " in parent else parent))
        try:
            self._lay_out(installation, race)
        except BaseException:
            self.remove()
            raise
        folders = {"-l": "local", "-L": "lib", "-D": "data", "-r": "local/race.xml"}
        arguments = [part for option, name in folders.items() for part in (option, str(self.root / name))]
        self.command = [str(installation.library / "torcs-bin"), *arguments]
        self.environment = {**os.environ, "LD_LIBRARY_PATH": str(installation.library / "lib")}
        self.environment.pop("DISPLAY", None)  # it needs none

    def _lay_out(self, installation: Installation, race: Race) -> None:
        library, data, local = (self.root / name for name in ("lib", "data", "local"))
        _mirror(installation.library, library, "drivers")
        if race.robot == "lockstep":
            (library / "drivers" / race.robot).mkdir()
            (library / "drivers" / race.robot / "lockstep.so").symlink_to(installation.robot)
        _mirror(installation.data, data, "cars")
        (data / "cars" / OWN_CAR).mkdir()
        (data / "cars" / OWN_CAR / f"{OWN_CAR}.xml").symlink_to(HERE / f"{OWN_CAR}.xml")
        (local / "config").mkdir(parents=True)
        (local / "results").mkdir()
        shutil.copy(installation.data / "config" / "raceengine.xml", local / "config")  # TORCS writes to it
        names = {"track": race.track, "category": installation.tracks()[race.track], "car": race.car}
        names |= {"robot": race.robot, "index": str(race.index), "laps": str(race.laps)}
        (local / "race.xml").write_text(_RACE.substitute(names))
        driver = local / "drivers" / race.robot / f"{race.robot}.xml"
        driver.parent.mkdir(parents=True)
        driver.write_text(_ROBOT.substitute(names))

    def results(self) -> list[Path]:
        """The files with the results of the race."""
        return sorted((self.root / "local" / "results").rglob("*.xml"))

    def remove(self) -> None:
        """Deletes the tree."""
        shutil.rmtree(self.root, ignore_errors=True)


def _mirror(source: Path, target: Path, open_folder: str) -> None:
    """Links to everything in ``source``; one folder becomes a real one, with links to what is in there."""
    target.mkdir()
    for entry in source.iterdir():
        if entry.name != open_folder:
            (target / entry.name).symlink_to(entry)
    (target / open_folder).mkdir()
    for entry in (source / open_folder).iterdir():
        (target / open_folder / entry.name).symlink_to(entry)
