# Simulation servers, broker and optimization tool in one image: docs/how-to/install.md.
# The wheel comes from `make wheel`; another base is any with Python 3.11 or newer as python3, with the module venv.
ARG BASE=python:3.11-slim-bookworm

FROM ${BASE} AS install
ARG WHEEL=build/wheel/dist
# Packages beside those that runs need, for example matplotlib for figures.
ARG PACKAGES=""
COPY ${WHEEL}/*.whl /wheel/
RUN python3 -m venv /opt/swarmwright \
    && /opt/swarmwright/bin/pip install --no-cache-dir --no-compile --no-deps /wheel/*.whl \
    && /opt/swarmwright/bin/python -c "from importlib.metadata import requires; print(*[one for one in requires('swarmwright') if 'extra' not in one and not one.startswith(('matplotlib', 'pillow', 'scipy'))], sep='\n')" > /tmp/needed \
    && /opt/swarmwright/bin/pip install --no-cache-dir --no-compile --only-binary=:all: -r /tmp/needed ${PACKAGES} \
    && /opt/swarmwright/bin/pip uninstall --yes setuptools pip \
    && find /opt/swarmwright -type d -name tests -path '*/numpy/*' -prune -exec rm -r {} +

FROM ${BASE}
LABEL org.opencontainers.image.title="Swarmwright" \
      org.opencontainers.image.description="Evolves controllers for swarms of robots on simulation servers through an MQTT broker" \
      org.opencontainers.image.licenses="Apache-2.0"
COPY --from=install /opt/swarmwright /opt/swarmwright
# Runs are written to /work; everything else may be read-only.
ENV PATH=/opt/swarmwright/bin:$PATH \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    SWARMWRIGHT_PLOT=0 \
    HOME=/work
RUN install -d -o 10001 -g 10001 /work
WORKDIR /work
USER 10001:10001
STOPSIGNAL SIGTERM
ENTRYPOINT ["swarmwright"]
CMD ["--help"]
