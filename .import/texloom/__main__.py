"""The command ``texloom``, and ``python -m texloom``."""

import os
import signal

# Of NumPy and OpenCV, which read these when they are imported, here and in worker processes.
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
_WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}


def _end(number: int, _: object) -> None:
    """End at once: nothing has begun, and an exception might be taken by a library that is being imported."""
    os.write(2, f"texloom: {_WORDS[signal.Signals(number)]}\n".encode())
    os._exit(128 + number)


def main() -> None:
    """Run the command line and exit; signals are handled before anything is imported."""
    os.environ |= dict.fromkeys(_ONE_THREAD, "1")
    for number in _WORDS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _end)
    from texloom.pipelines.cli.main import main as run

    run()


if __name__ == "__main__":
    main()
