"""RTKLIB-style solution files: baseline in east, north, up, as ``rnx2rtkp -a -t`` writes them.

Standard deviations of the cross terms are signed roots of the covariances. Epochs without a
solution are left out, as RTKLIB does; held integers count as fixed.

References
----------
T. Takasu, RTKLIB 2.4.2 manual, appendix B.1 (positioning solution file).
"""

import numpy as np

from ..errors import Status
from ..timescales import format_gpst, gpst_to_datetime64, week_from_gpst

__all__ = ["pos_text"]

_COLUMNS = (
    "%  GPST                    e-baseline(m)  n-baseline(m)  u-baseline(m)   Q  ns   sde(m)   sdn(m)"
    "   sdu(m)  sden(m)  sdnu(m)  sdue(m) age(s)  ratio\n"
)
_ROW = "%s %14.4f %14.4f %14.4f %3d %3d %8.4f %8.4f %8.4f %8.4f %8.4f %8.4f %6.2f %6.1f\n"


def pos_text(solution):
    """The result in RTKLIB's ``.pos`` form.

    Parameters
    ----------
    solution : BaselineSolution
        Result of `truenorth.solve_baseline`.

    Returns
    -------
    str
    """
    from .. import __version__

    lines = [f"% program   : TrueNorth ver.{__version__}\n"]
    lines += [f"% inp file  : {name}\n" for name in input_paths(solution)]
    for word, time_ns in zip(
        ("start", "end  "), solution.time_ns[[0, -1]] if solution.n_epochs else (), strict=False
    ):
        week, tow_s = week_from_gpst(int(time_ns))
        stamp = format_gpst(time_ns, decimals=1).replace("-", "/").replace("T", " ")
        lines.append(f"% obs {word} : {stamp} GPST (week{week:04d} {tow_s:.1f}s)\n")
    lines.append(
        "%\n% (e/n/u-baseline=WGS84,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)\n"
    )
    lines.append(_COLUMNS)

    keep = (solution.status != Status.NONE) & np.isfinite(solution.baseline_enu_m).all(axis=1)
    covariance = solution.cov_enu_m2[keep]
    roots = np.sign(covariance) * np.sqrt(np.abs(covariance))
    stamps = np.datetime_as_string(gpst_to_datetime64(solution.time_ns[keep]), unit="ms")
    quality = np.where(solution.status[keep] == Status.FLOAT, 2, 1)
    rows = zip(
        (stamp.replace("-", "/").replace("T", " ") for stamp in stamps.tolist()),
        *solution.baseline_enu_m[keep].T.tolist(),
        quality.tolist(),
        solution.n_sats[keep].tolist(),
        *(roots[:, i, j].tolist() for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))),
        [0.0] * int(np.count_nonzero(keep)),
        np.nan_to_num(solution.ratio[keep]).tolist(),
        strict=True,
    )
    lines += [_ROW % row for row in rows]
    return "".join(lines)


def input_paths(solution):
    """Names of the input files that a solution remembers, in reading order."""
    found = []

    def collect(value):
        if isinstance(value, dict):
            if "path" in value:
                collect(value["path"])
            else:
                for inner in value.values():
                    collect(inner)
        elif isinstance(value, list | tuple):
            for inner in value:
                collect(inner)
        elif isinstance(value, str) and value:
            found.append(value)

    collect({key: solution.inputs.get(key, ()) for key in ("rover", "base", "navigation")})
    return found
