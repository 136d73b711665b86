"""Compile time of every kernel in a first run: python benchmarks/compile_time.py [--write].

A first run is a solution of the one-metre pair with an empty cache of compiled code; the times of
nested kernels are inside those of their callers, so the total is that of the outermost ones.
"""

import os
import sys
import tempfile
import time

from machine import conditions, parser, report, table


def main():
    """Solve once with an empty cache, listening to the compiler, and print the table."""
    arguments = parser(__doc__.splitlines()[0]).parse_args()
    with tempfile.TemporaryDirectory() as cache:
        os.environ["NUMBA_CACHE_DIR"] = cache
        from numba.core import event

        spent, depth, outermost = {}, [], 0.0

        class Listener(event.Listener):
            def on_start(self, event):
                depth.append(time.perf_counter())

            def on_end(self, event):
                nonlocal outermost
                seconds = time.perf_counter() - depth.pop()
                dispatcher = event.data["dispatcher"]
                name = f"{dispatcher.py_func.__module__.rpartition('.')[2]}.{dispatcher.py_func.__name__}"
                count, total = spent.get(name, (0, 0.0))
                spent[name] = (count + 1, total + seconds)
                if not depth:
                    outermost += seconds

        event.register("numba:compile", Listener())
        import truenorth as tn

        pair = tn.datasets.fetch("pair_1m_geodetic")
        start = time.perf_counter()
        tn.solve_baseline(
            pair.files["base"], pair.files["rover"], pair.navigation, length_m=0.990, length_sd_m=0.003
        )
        whole = time.perf_counter() - start
    rows = [
        [f"`{name}`", str(count), f"{seconds:.2f} s"]
        for name, (count, seconds) in sorted(spent.items(), key=lambda item: -item[1][1])
    ]
    rows.append(
        ["all (nested ones once)", str(sum(count for count, _ in spent.values())), f"{outermost:.2f} s"]
    )
    lines = [
        *conditions(),
        f"- first run of the whole solution: {whole:.1f} s, of which {outermost:.1f} s compiling",
        "",
        *table(["kernel", "specialisations", "compile time"], rows),
    ]
    report("Compile time of a first run", lines, write=arguments.write)


if __name__ == "__main__":
    sys.exit(main())
