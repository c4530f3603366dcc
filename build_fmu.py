"""Builds FMUs of tensegrity scenes and validates them: python build_fmu.py three_bar_nsh (or python -m fmu_src.build)."""

from tensegrity_core.interrupts import program


def main() -> int:
    from fmu_src.build import main

    return main()


if __name__ == "__main__":
    program(main)
