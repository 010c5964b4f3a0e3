"""What `palpate compile` reads: a fitted model of another library from a file, and tables."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.csv_dialect import dialect_of
from palpate.errors import MissingExtra, NoSuchFile, UsageError
from palpate.files import by_suffix

if TYPE_CHECKING:
    import pandas as pd

_PURPOSE = "reading a model of scikit-learn"


def read_model(path: Path, trust: bool) -> Any:
    """A fitted model, by its file's suffix.

    Parameters
    ----------
    trust : bool
        The file may run whatever it holds: a pickle always, skops' format where it names types of its own.

    Raises
    ------
    NoSuchFile, UnknownFormat
        The file itself.
    UsageError
        It would run code, or holds no model.
    MissingExtra
        Without the packages of the extra `sklearn`.
    """
    readers = {".skops": _skops, ".joblib": _pickle, ".pkl": _pickle, ".pickle": _pickle}
    read = by_suffix(path, readers)
    if not path.is_file():
        raise NoSuchFile(f"there is no model {path}; check the name")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of another version: errors are told against what it predicts
            return read(path, trust)
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing in ("joblib", "skops", "sklearn"):
            package = "scikit-learn" if missing == "sklearn" else missing
            raise MissingExtra(package, "sklearn", _PURPOSE) from None
        raise UsageError(f"{path} needs the Python package {error.name!r}; install it") from None
    except UsageError:
        raise
    except Exception as error:  # whatever a damaged file makes of a reader
        why = str(error).split("\n")[0].rstrip(".") or type(error).__name__
        raise UsageError(f"{path} cannot be read as a model: {why}") from None


def _skops(path: Path, trust: bool) -> Any:
    from skops import io

    unknown = io.get_untrusted_types(file=path)
    if unknown and not trust:
        raise UsageError(
            f"{path} holds what skops does not know to be harmless, as {unknown[0]}; if it comes from where "
            "you trust, say --trust"
        )
    return io.load(path, trusted=unknown)


def _pickle(path: Path, trust: bool) -> Any:
    if not trust:
        raise UsageError(
            f"{path} is a pickle, which runs whatever code it holds when it is read; save the model by "
            "skops.io.dump, or say --trust if it is your own"
        )
    import joblib

    return joblib.load(path)


def read_table(path: Path) -> pd.DataFrame:
    """A table with columns by name.

    Raises
    ------
    NoSuchFile, UnknownFormat
        The file itself.
    UsageError
        It holds no table.
    """
    import pandas as pd

    def csv(path: Path) -> pd.DataFrame:
        sep, decimal = dialect_of(path)
        return pd.read_csv(path, sep=sep, decimal=decimal)

    readers: dict[str, Callable[..., pd.DataFrame]] = {".csv": csv, ".parquet": pd.read_parquet}
    read = by_suffix(path, readers)
    if not path.is_file():
        raise NoSuchFile(f"there is no table {path}; check the name")
    try:
        table = read(path)
    except (ValueError, OSError) as error:
        why = str(error).split("\n")[0].rstrip(".")
        raise UsageError(f"{path} cannot be read as a table: {why}") from None
    table.columns = table.columns.astype(str)
    return table


def features_of(model: Any, table: pd.DataFrame, path: Path, targets: tuple[str, ...]) -> pd.DataFrame:
    """The columns that a model takes: those whose names it was fitted to, else all that are no targets."""
    absent = [name for name in targets if name not in table.columns]
    if absent:
        raise UsageError(f"{path} has no column {absent[0]!r}; it has {', '.join(table.columns)}")
    names = _names(model)
    if names is None:
        names = [name for name in table.columns if name not in targets]
    missing = [name for name in names if name not in table.columns]
    if missing:
        raise UsageError(
            f"the model was fitted to a column {missing[0]!r}, which {path} does not have; it has "
            f"{', '.join(table.columns)}"
        )
    count = getattr(model, "n_features_in_", len(names))
    if len(names) != count:
        raise UsageError(
            f"the model takes {count} features, without names, and {path} has {len(names)} columns; name "
            "those that are none with --target"
        )
    return finite(table[names], path)


def finite(rows: pd.DataFrame, path: Path) -> pd.DataFrame:
    """The rows; `UsageError` names the first cell that holds no finite number, the heads being row 1."""
    import numpy as np
    import pandas as pd

    if rows.empty:
        raise UsageError(f"{path} has no rows")
    found = np.column_stack([pd.to_numeric(rows[name], errors="coerce") for name in rows])
    bad = np.argwhere(~np.isfinite(found.astype(float)))
    if len(bad):
        row, column = bad[0]
        said = f"{str(rows.iat[row, column])!r} is no finite number"
        raise UsageError(f"{path}, row {row + 2}, {rows.columns[column]}: {said}")
    return rows


def _names(model: Any) -> list[str] | None:
    if is_of_statsmodels(model):
        return [name for name in model.model.exog_names if name not in ("const", "Intercept")]
    names = getattr(model, "feature_names_in_", None)
    return None if names is None else list(names)


def is_of_statsmodels(model: Any) -> bool:
    """Whether these are results of statsmodels."""
    return hasattr(model, "params") and hasattr(getattr(model, "model", None), "exog_names")
