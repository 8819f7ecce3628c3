"""Lists the examples, or runs one.

    python -m pairmask.examples
    python -m pairmask.examples worlds_batch --worlds 256 --steps 10
"""

import ast
import pathlib
import runpy
import sys

COMMAND = "python -m pairmask.examples"
# Packages that some examples need beside numpy, and the extra of pairmask that brings each.
EXTRAS = {"rerun": "rerun"}


def examples() -> dict[str, str]:
    """Names of the examples, and the first line of what each says about itself. None is imported."""
    files = sorted(pathlib.Path(__file__).parent.glob("[!_]*.py"))
    texts = {file.stem: ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "" for file in files}
    return {name: text.partition("\n")[0] for name, text in texts.items()}


def main() -> int:
    known = examples()
    if len(sys.argv) == 1:
        width = max(map(len, known))
        print("\n".join(f"{name:<{width}}  {text}" for name, text in known.items()))
        print(f"\nRun one: {COMMAND} NAME, with --help for its options.")
        return 0
    name = sys.argv[1]
    if name not in known:
        print(f"there is no example '{name}', but {', '.join(known)}", file=sys.stderr)
        return 2
    sys.argv = [f"{COMMAND} {name}", *sys.argv[2:]]
    try:
        runpy.run_module(f"{__package__}.{name}", run_name="__main__")
    except ModuleNotFoundError as error:
        extra = EXTRAS.get(error.name or "")
        if extra is None:
            raise
        print(f"{name} needs the package '{error.name}': pip install 'pairmask[{extra}]'", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
