"""Every failure ends in one message and the right exit code."""

from __future__ import annotations

import sys
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import typer

INTERNAL, USER, INTERRUPTED = 1, 2, 130


@contextmanager
def reported(verbose: bool = False) -> Iterator[None]:
    """Turn exceptions into a message on stderr and typer.Exit: 2 if the user can mend it, else 1; 130 interrupted."""
    from strainsight.errors import StrainsightError

    with warnings.catch_warnings():
        if not verbose:
            warnings.simplefilter("ignore")
            warnings.simplefilter("default", UserWarning)
        warnings.showwarning = _warn
        try:
            yield
        except (typer.Exit, BrokenPipeError):
            raise
        except StrainsightError as error:
            raise _exit(error.exit_code, str(error), verbose and error.exit_code == INTERNAL) from None
        except KeyboardInterrupt:
            raise _exit(INTERRUPTED, "interrupted; finished stages are kept", False) from None
        except OSError as error:
            if error.filename is None or error.strerror is None:
                raise _exit(INTERNAL, _internal(error), verbose) from None
            remedy = "make the path readable and writable, or give another one"
            raise _exit(USER, f"{error.filename}  {error.strerror}\n    {remedy}", verbose) from None
        except Exception as error:
            raise _exit(INTERNAL, _internal(error), verbose) from None


def _internal(error: BaseException) -> str:
    return f"internal error: {type(error).__name__}: {error}\n    run again with -v for the details, and report them"


def _exit(code: int, message: str, with_traceback: bool) -> typer.Exit:
    if with_traceback:
        traceback.print_exc()
    print(message, file=sys.stderr)
    return typer.Exit(code)


def _warn(message: Warning | str, *_: object, **__: object) -> None:
    print(f"warning: {message}", file=sys.stderr)
