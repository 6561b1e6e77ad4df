"""python -m sed2cad"""

from sed2cad.cli import main

if __name__ == "__main__":
    main()
