# The program on a machine that has nothing but Docker or Podman (docs/install.md):
#   docker build -t looping-pendulum .
#   docker run --name pendulum looping-pendulum                                      (the demonstration)
#   docker cp pendulum:/home/student/project/report .                                (its pages, to open in a browser)
#   docker run --rm looping-pendulum looping-pendulum run two_to_one                 (or any other command)
#   docker build --target tests -t looping-pendulum-tests . && docker run --rm looping-pendulum-tests      (make test)
# Python 3.11, since PyBullet has wheels only up to there.
FROM python:3.11-slim AS base

RUN apt-get update \
    && apt-get install --yes --no-install-recommends make \
    && rm -rf /var/lib/apt/lists/*

# Not root: engine runs are ordinary processes, and what they write belongs to a user.
RUN useradd --create-home --uid 1000 student
USER student
WORKDIR /home/student/project
ENV PATH="/home/student/project/.venv/bin:$PATH"

# The dependencies first: while pyproject.toml stays, a change of the code does not install them again.
COPY --chown=student pyproject.toml README.md LICENSE Makefile ./
COPY --chown=student looping_pendulum/__init__.py looping_pendulum/__init__.py
RUN make .venv/main PYTHON=python3

FROM base AS tests
# Chromium is for the browser tests only, which are skipped without one.
USER root
RUN apt-get update \
    && apt-get install --yes --no-install-recommends chromium-headless-shell \
    && rm -rf /var/lib/apt/lists/*
USER student
RUN make .venv/test PYTHON=python3
COPY --chown=student . .
# An editable install has the code's folder, but make looks at times: the copied pyproject.toml is not newer than what was installed by it.
RUN touch .venv/uv && touch .venv/main .venv/test
CMD ["make", "test"]

# The last stage is what `docker build` makes if no other is named.
FROM base AS program
COPY --chown=student . .
CMD ["looping-pendulum", "demo", "--no-open"]
