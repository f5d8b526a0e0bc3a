# boxcal in a container: `docker build --tag boxcal .`, then
#   docker run --rm --volume "$PWD:/data" --user "$(id -u):$(id -g)" boxcal fleet-calibrate robots/*.mcap
# The folder of the host that is mounted at /data holds the logs and gets the results.

# Wheels of boxcal and of what it needs are built where compilers may be, and only they are taken along.
FROM python:3.12-slim AS build
WORKDIR /src
COPY . .
RUN python -m pip wheel --no-cache-dir --constraint constraints.txt --wheel-dir /wheels '.[report]'

FROM python:3.12-slim
RUN --mount=type=bind,from=build,source=/wheels,target=/wheels \
    python -m pip install --no-cache-dir --no-index --find-links /wheels "$(ls /wheels/boxcal-*.whl)[report]" \
    && useradd --create-home --uid 1000 boxcal
# boxcal's wheel has compiled code inside for the processor that built it; on another, code is kept where any may write.
ENV NUMBA_CACHE_DIR=/tmp/boxcal-numba PYTHONUNBUFFERED=1
USER 1000
WORKDIR /data
ENTRYPOINT ["boxcal"]
CMD ["--help"]
