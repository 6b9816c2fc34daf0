import os
import signal
import subprocess
import sys
import textwrap

import pytest

from dpsearch.runs.interruption import Interrupted, Interruption
from tests.support.application import ROOT

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_is_noted_and_answered_and_the_next_ends_the_process(
    number: signal.Signals, capfd: pytest.CaptureFixture[str]
) -> None:
    before = signal.getsignal(number)
    with Interruption() as interruption:
        assert interruption.signal is None
        interruption.check()
        os.kill(os.getpid(), number)
        assert interruption.signal is number
        assert [signal.getsignal(each) for each in SIGNALS] == [signal.SIG_DFL] * 3
        with pytest.raises(Interrupted), interruption.at_once():
            pass
    assert signal.getsignal(number) is before
    assert capfd.readouterr().err == f"{number.name}: stopping after this update; once more stops at once\n"


@pytest.mark.parametrize("number", SIGNALS)
def test_where_nothing_is_to_be_finished_a_signal_is_raised(number: signal.Signals) -> None:
    def play() -> None:
        with interruption.at_once():
            os.kill(os.getpid(), number)
            raise AssertionError("it was not raised")

    with Interruption() as interruption:
        with pytest.raises(Interrupted):
            play()
        assert interruption.signal is number


def run(code: str) -> "subprocess.CompletedProcess[str]":
    code = "import os, signal\nfrom dpsearch.runs.interruption import Interruption\n" + textwrap.dedent(code)
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)


def test_the_second_of_two_signals_ends_the_process_at_once() -> None:
    result = run("""
        with Interruption():
            for _ in range(2): os.kill(os.getpid(), signal.SIGINT)
            print('still here')
    """)
    assert result.returncode == -signal.SIGINT
    assert result.stdout == ""


def test_code_that_keeps_the_handlers_of_python_waiting_is_answered_and_ended_too() -> None:
    result = run("""
        import ctypes, subprocess, sys
        kill = "import os, time; time.sleep({}); os.kill({}, 15)"
        with Interruption():
            for seconds in (0.5, 1.5):
                subprocess.Popen([sys.executable, "-c", kill.format(seconds, os.getpid())])
            signals = (ctypes.c_ulong * 16)(1 << signal.SIGTERM - 1)
            ctypes.CDLL(None).pthread_sigmask(signal.SIG_BLOCK, signals, None)  # left to other threads
            ctypes.CDLL(None).sleep(60)
            print('still here')
    """)
    assert result.stdout == ""
    assert result.stderr == "SIGTERM: stopping after this update; once more stops at once\n"
    assert result.returncode == 128 + signal.SIGTERM
