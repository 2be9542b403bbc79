"""Compiles the repository's protobuf files into the package while it is built."""
import shutil
from importlib.metadata import requires
from importlib.resources import files
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

PROTO = Path(__file__).resolve().parents[2] / "proto"


class WithStubs(build_py):
    def run(self):
        super().run()
        from grpc_tools import protoc

        sources = [str(p.relative_to(PROTO)) for p in sorted(PROTO.glob("vrdp/v1/*.proto")) if p.stem != "recording"]
        if not sources:
            raise SystemExit(f"no protobuf files in {PROTO}: install from a checkout of the repository")
        out = self.build_lib
        include = [f"-I{PROTO}", f"-I{files('grpc_tools') / '_proto'}"]
        code = protoc.main(["protoc", *include, f"--python_out={out}", f"--pyi_out={out}", f"--grpc_python_out={out}", *sources])
        if code:
            raise SystemExit(code)
        Path(out, "vrdp", "v1", "__init__.py").touch()
        shutil.copy(PROTO / "vrdp/v1/service_config.json", Path(out, "vrdp", "v1"))


# Stubs want at least the libraries of the compiler that made them.
needs = [r for r in requires("grpcio-tools") or [] if r.startswith(("grpcio", "protobuf"))]
setup(cmdclass={"build_py": WithStubs}, install_requires=needs)
