# Aerofed in a container; the results are left in the folder that is mounted on /work:
#
#     docker build --tag aerofed .
#     docker run --rm --user "$(id -u):$(id -g)" --volume "$PWD:/work" aerofed run
FROM python:3.13-slim AS build
WORKDIR /src
COPY . .
# Compiles the native code; the build fetches a C compiler of its own.
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.13-slim
COPY --from=build /wheels /wheels
COPY requirements.lock /wheels/
RUN pip install --no-cache-dir --constraint /wheels/requirements.lock /wheels/*.whl && rm -r /wheels
# Whoever the user is, who has no home here.
ENV HOME=/tmp
WORKDIR /work
ENTRYPOINT ["aerofed"]
CMD ["run"]
