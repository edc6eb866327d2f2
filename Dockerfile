# The servers, robots and commands of RoboCorba; compose.yaml runs a system of them. Linux x86-64.
FROM python:3.12-slim
COPY . /source
RUN pip install --no-cache-dir '/source[console,films]' && rm -r /source \
    && useradd --create-home robocorba \
    && install --directory --owner robocorba /state /cache
USER robocorba
WORKDIR /home/robocorba
# The state folder, and the kernels that the first start compiles.
ENV ROBOCORBA_STATE=/state XDG_CACHE_HOME=/cache
VOLUME ["/state", "/cache"]
RUN ["robocorba", "samples", "copy", "paper-scene.yaml"]
ENTRYPOINT ["robocorba"]
CMD ["up", "--console"]
# The first start compiles kernels for some minutes.
HEALTHCHECK --start-period=10m --interval=10s --timeout=20s CMD ["robocorba", "status"]
