# docker build -t jbench . && docker run -v "$PWD/results:/work/results" jbench train --seeds 0 --steps 100000
FROM python:3.12-slim
RUN apt-get update && apt-get install -y --no-install-recommends libosmesa6 && rm -rf /var/lib/apt/lists/*
ENV MUJOCO_GL=osmesa
RUN pip install --no-cache-dir torch==2.13.0 --index-url https://download.pytorch.org/whl/cpu
WORKDIR /src
COPY . .
# The tested versions, without the hashes of the lock, which a checkout has none of.
RUN grep -o '^[A-Za-z0-9_.-]*==[^ ]*' requirements.lock > /tmp/constraints.txt && \
    pip install --no-cache-dir --constraint /tmp/constraints.txt '.[render]'
WORKDIR /work
ENTRYPOINT ["jbench"]
CMD ["demo"]
