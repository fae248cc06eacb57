# knotfab on the CPU, with PrusaSlicer and off-screen rendering through EGL:
#   docker build -t knotfab .                    (--build-arg TORCH_INDEX=… : torch for the CPU alone)
#   docker run --rm -v "$PWD":/work knotfab build cat.png --print --out cat
FROM python:3.11-slim-bookworm

RUN apt-get update \
 && apt-get install -y --no-install-recommends libegl1 libgl1 libgomp1 prusa-slicer \
 && rm -rf /var/lib/apt/lists/*

WORKDIR /src
COPY constraints.txt pyproject.toml README.md LICENSE ./
ARG TORCH_INDEX=
RUN pip install --no-cache-dir -c constraints.txt --no-deps ${TORCH_INDEX:+--index-url "$TORCH_INDEX"} torch==2.13.0
COPY knotfab knotfab
COPY formats formats
COPY validators validators
COPY fixtures fixtures
RUN pip install --no-cache-dir -c constraints.txt '.[studio]'

# what is compiled is kept where any user may write
ENV NUMBA_CACHE_DIR=/tmp/numba
RUN knotfab doctor --compile && chmod -R a+rwX /tmp/numba
WORKDIR /work
ENTRYPOINT ["knotfab"]
CMD ["--help"]
