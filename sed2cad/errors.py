"""What can go wrong, one class per exit code. The message is one sentence for a machinist."""

from __future__ import annotations


class Sed2cadError(Exception):
    """Base of all errors that sed2cad raises on purpose; `exit_code` is what the command ends with."""

    exit_code = 1


class UsageError(Sed2cadError, ValueError):
    """The call does not make sense: unknown option value, unknown parameter, unwritable output."""

    exit_code = 2


class ScanError(Sed2cadError, ValueError):
    """The scan cannot be read or holds nothing to reconstruct."""

    exit_code = 3


class AssemblyError(Sed2cadError, RuntimeError):
    """No closed solid could be built."""

    exit_code = 4


class WeightsError(Sed2cadError, ValueError):
    """The network's weights are missing, damaged or of another network."""

    exit_code = 5
