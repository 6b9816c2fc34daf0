"""The TORCS process: nothing is left of it, whatever dies first, and nobody else can reach it."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from dpsearch.envs import TORCS
from dpsearch.envs.torcs import Installation, Simulator, TorcsError, installation
from tests.support.torcs_wanted import require_torcs

require_torcs()

ROOT = Path(__file__).parents[3]
COMMAND = r"run bash scripts/build_torcs.sh"


def is_there(pid: int) -> bool:
    """Whether a process exists and is not just waiting to be buried."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def require_end(pid: int) -> None:
    for _ in range(3000):
        if not is_there(pid):
            return
        time.sleep(0.01)
    pytest.fail(f"process {pid} is still there")


def memory(pid: int) -> int:
    """Resident memory (kB)."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmRSS")).split()[1])


def python(code: str) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, text=True)


def test_torcs_ends_when_its_client_is_killed() -> None:
    code = "import dpsearch.envs.torcs as t; s = t.Simulator(); print(s.pid, flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", code], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as client:
        assert client.stdout is not None
        pid = int(client.stdout.readline())
        assert is_there(pid)
        client.kill()
        client.wait()
        require_end(pid)


def test_torcs_ends_when_its_client_is_silent() -> None:
    simulator = Simulator(patience=0.3)
    require_end(simulator.pid)
    with pytest.raises(TorcsError, match="silent for too long"):
        simulator.put(0.0, 10.0)


def test_torcs_ends_with_the_program_that_forgot_to_close_it() -> None:
    code = "import dpsearch.envs.torcs as t; s = t.Simulator(); s.put(0.0, 10.0); print(s.pid)"
    with python(code) as client:
        pid = int(client.communicate()[0])
    assert client.returncode == 0
    assert not is_there(pid)


def test_torcs_ends_when_the_environment_is_closed_or_forgotten() -> None:
    for forget in (False, True):
        env = TORCS()
        env.reset()
        assert env.simulator is not None
        pid = env.simulator.pid
        if not forget:
            env.close()
        del env
        gc.collect()
        assert not is_there(pid)


def test_a_fork_that_ends_does_not_take_torcs_with_it() -> None:
    code = """if True:
        import os, sys
        import dpsearch.envs.torcs as t
        simulator = t.Simulator()
        if os.fork() == 0:
            del simulator
            sys.exit()
        os.wait()
        print(simulator.put(0.0, 10.0).speed > 9.0)
    """
    with python(code) as client:
        assert client.communicate()[0] == "True\n"


def test_when_torcs_is_killed_there_is_one_clear_error_and_the_next_reset_starts_it_anew() -> None:
    env = TORCS()
    before, _ = env.reset(seed=0)
    assert env.simulator is not None
    os.kill(env.simulator.pid, signal.SIGKILL)
    with pytest.raises(TorcsError, match=r"^TORCS was killed by SIGKILL; a reset starts it anew$"):
        env.step(np.zeros(1, np.float32))
    with pytest.raises(TorcsError, match=r"^this TORCS has been closed; a reset starts it anew$"):
        env.step(np.zeros(1, np.float32))
    after, _ = env.reset(seed=0)
    assert (after == before).all()
    os.kill(env.simulator.pid, signal.SIGKILL)
    require_end(env.simulator.pid)
    assert (env.reset(seed=0)[0] == before).all()
    env.close()
    env.close()


def test_torcs_s_own_words_are_passed_on_when_it_does_not_start(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    installed = Installation.find()
    (tmp_path / "torcs-bin").write_text("#!/bin/sh\necho no luck today\nexit 3\n")
    (tmp_path / "torcs-bin").chmod(0o755)
    (tmp_path / "drivers").mkdir()
    broken = Installation(tmp_path, installed.data, installed.robot)
    monkeypatch.setattr(Installation, "find", lambda: broken)
    with pytest.raises(TorcsError, match=r"^TORCS ended with exit code 3; its last words: no luck today$"):
        Simulator()


def test_nothing_is_left_on_disk_even_while_it_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    simulator = Simulator()
    assert list(tmp_path.iterdir()) == []
    simulator.put(0.0, 10.0)
    simulator.close()
    with pytest.raises(ValueError, match="track must be one of"):
        Simulator("monaco")
    assert list(tmp_path.iterdir()) == []


def test_torcs_has_no_socket_in_the_network() -> None:
    simulator = Simulator()
    links = [os.readlink(path) for path in Path(f"/proc/{simulator.pid}/fd").iterdir()]
    sockets = {link[8:-1] for link in links if link.startswith("socket:[")}
    assert len(sockets) == 1
    for table in ("tcp", "tcp6", "udp", "udp6"):
        path = Path(f"/proc/{simulator.pid}/net/{table}")
        lines = path.read_text().splitlines()[1:] if path.is_file() else []
        assert not sockets & {line.split()[9] for line in lines}
    simulator.close()


def test_five_hundred_resets_need_no_more_memory() -> None:
    simulator = Simulator()

    def reset(times: int) -> None:
        for k in range(times):
            simulator.put(6.0 * k, 15.0)
            simulator.hold(0.1, 15.0)

    reset(100)
    pids = (simulator.pid, os.getpid())
    before = [memory(pid) for pid in pids]
    reset(500)
    grown = [memory(pid) - old for pid, old in zip(pids, before, strict=True)]
    simulator.close()
    assert max(grown) < 1000  # kB: 2 a reset


def test_missing_parts_are_named_with_the_command_that_installs_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(
        TorcsError, match=f"^TORCS is installed, but our robot for it, {tmp_path}/.*, is missing: {COMMAND}"
    ):
        TORCS()
    monkeypatch.setattr(installation, "_LIBRARIES", (f"{tmp_path}/torcs",))
    with pytest.raises(TorcsError, match=f"^TORCS is not installed: {COMMAND}"):
        TORCS()


@pytest.mark.parametrize("command", [["bash", "scripts/build_torcs.sh"], [sys.executable, "-m", "dpsearch.envs.torcs"]])
def test_the_script_does_nothing_where_all_is_done(command: list[str]) -> None:
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert (result.stdout, result.stderr) == ("build_torcs: TORCS is ready for dpsearch/TORCS-v0\n", "")
    assert "usage:" in subprocess.run([*command, "--help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
