"""The command line as a process of its own."""

import os
import signal
import subprocess
import sys


class Started(subprocess.Popen):
    """A program that a test which fails does not wait for."""

    def __exit__(self, *error):
        if error[0] is not None:
            self.kill()
        super().__exit__(*error)


def start_palpate(*args, prepare=lambda: None, **options):
    """The command line as a process of its own; `prepare` is called in it before it begins."""

    def begin():
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # the tests themselves may run where Ctrl-C is ignored
        prepare()

    command = [sys.executable, "-m", "palpate.cli", *(str(arg) for arg in args)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", **options.pop("env", {})}
    return Started(command, env=environment, preexec_fn=begin, **{**pipes, **options})
