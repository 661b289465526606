# Aerofed in a container; the results are left in the folder that is mounted on /work:
#
#     docker build --tag aerofed .
#     docker run --rm --user "$(id -u):$(id -g)" --volume "$PWD:/work" aerofed run
#
# The simulated vehicle alone (aerofed sitl, aerofed world), in little more than half the space:
#
#     docker build --target vehicle --tag aerofed-vehicle .
#     docker run --rm --publish 14540:14540/udp aerofed-vehicle
FROM python:3.13-slim AS build
WORKDIR /src
COPY . .
# Compiles the native code; the build fetches a C compiler of its own.
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels . && cp requirements.lock /wheels

FROM python:3.13-slim AS base
# Whoever the user is, who has no home here.
ENV HOME=/tmp
WORKDIR /work
ENTRYPOINT ["aerofed"]

FROM base AS vehicle
RUN --mount=type=bind,from=build,source=/wheels,target=/wheels \
    pip install --no-cache-dir --no-deps /wheels/*.whl && \
    pip install --no-cache-dir --constraint /wheels/requirements.lock \
        cloudpickle cyclopts filterpy foxglove-sdk jsbsim mavsdk mcap mcap-protobuf-support numpy \
        pydantic pymavlink rich scipy tomli-w zstandard
CMD ["sitl", "--udp", "udpin://0.0.0.0:14540"]

FROM base AS whole
RUN --mount=type=bind,from=build,source=/wheels,target=/wheels \
    pip install --no-cache-dir --constraint /wheels/requirements.lock /wheels/*.whl
CMD ["run"]
