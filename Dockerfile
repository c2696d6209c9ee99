# docker build -t jbench . && docker run -v "$PWD/results:/work/results" jbench train --seeds 0 --steps 100000
FROM python:3.12-slim
RUN apt-get update && apt-get install -y --no-install-recommends libosmesa6 && rm -rf /var/lib/apt/lists/*
ENV MUJOCO_GL=osmesa
RUN pip install --no-cache-dir torch==2.13.0 --index-url https://download.pytorch.org/whl/cpu
WORKDIR /src
COPY . .
RUN pip install --no-cache-dir --constraint constraints.txt '.[render]'
WORKDIR /work
ENTRYPOINT ["jbench"]
CMD ["demo"]
