# Learner, actors and robot, each a target: docker build --target learner -t hdplanner-learner .
FROM python:3.11-slim-bookworm AS base
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONUNBUFFERED=1 HOME=/home/hdplanner
RUN useradd --create-home --uid 1000 hdplanner && mkdir /runs && chown hdplanner /runs
WORKDIR /src
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY common common
COPY actors actors
COPY learner learner
COPY deploy deploy
COPY hdplanner hdplanner

FROM base AS learner
RUN pip install -c constraints.txt '.[learner,plots,metrics,storage]'
USER 1000
WORKDIR /
VOLUME /runs
EXPOSE 7447
CMD ["hd-learner", "start", "--runs", "/runs", "--listen", "tcp/0.0.0.0:7447"]

FROM base AS actors
RUN pip install -c constraints.txt '.[actor,pybullet,metrics]'
USER 1000
WORKDIR /
CMD ["hd-actor", "--num", "2", "--connect", "tcp/learner:7447"]

FROM base AS robot
RUN pip install -c constraints.txt '.[robot,recording]'
USER 1000
WORKDIR /
CMD ["hd-deploy", "bridge"]
