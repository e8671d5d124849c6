# stream-sfm in a container: the two commands are in docs/quickstart.md.
FROM python:3.13-slim AS build
RUN apt-get update && apt-get install -y --no-install-recommends g++ && rm -rf /var/lib/apt/lists/*
COPY . '/source[study]'
RUN pip wheel --no-cache-dir --wheel-dir /wheels '/source[study]'

FROM python:3.13-slim
COPY --from=build /wheels /wheels
RUN pip install --no-cache-dir --no-index --find-links /wheels 'stream-sfm[study]' && rm -r /wheels
WORKDIR /data
ENTRYPOINT ["stream-sfm"]
CMD ["--help"]
