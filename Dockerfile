# README's two commands on a machine that has nothing:
#   docker build -t looping-pendulum .
#   docker run --rm -v "$PWD/report:/home/student/project/report" looping-pendulum                 (make compare, then make test)
#   docker run --rm looping-pendulum .venv/bin/looping-pendulum run two_to_one                     (or any other command)
# Python 3.11, since PyBullet has wheels only up to there.
FROM python:3.11-slim

# Chromium is for the browser tests only, which are skipped without one.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends make chromium \
    && rm -rf /var/lib/apt/lists/*

# Not root: engine runs are ordinary processes, and what they write belongs to a user. The folder that a volume covers must be hers beforehand.
RUN useradd --create-home --uid 1000 student
USER student
WORKDIR /home/student/project
RUN mkdir report

# The dependencies first: while pyproject.toml stays, a change of the code does not install them again.
COPY --chown=student pyproject.toml README.md LICENSE Makefile ./
COPY --chown=student looping_pendulum/__init__.py looping_pendulum/__init__.py
RUN make .venv/test PYTHON=python3
COPY --chown=student . .
# An editable install has the code's folder, but make looks at times: the copied pyproject.toml is not newer than what was installed by it.
RUN touch .venv/uv && touch .venv/main .venv/test

CMD ["sh", "-c", "make compare && make test"]
