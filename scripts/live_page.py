"""Write the live page that the documentation has, for those who open it without Python: `python -m scripts.live_page`."""

from pathlib import Path

from looping_pendulum.live.write import FILE, write

PAGE = Path(__file__).parents[1] / "docs" / FILE

if __name__ == "__main__":
    write(PAGE)
    print(f"wrote {PAGE}")
