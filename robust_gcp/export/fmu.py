"""A mechanism as a unit for co-simulation, FMI 2.0 or 3.0: the kernel is its binary, see fmu_unit.h."""

from __future__ import annotations

import hashlib
import io
import platform
import sys
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from ..errors import ModelError
from ..kernel.library import kernel_file
from ..mechanism.mechanism import Mechanism
from .description import described, identifier

INPUT, CONTROL, Q, V, CROSSINGS, TIME = 0, 100_000, 200_000, 300_000, 400_000, 500_000
"""Where the numbers of variables begin, as in fmu_unit.h."""

FOLDERS = {
    2: {("linux", "x86_64"): "linux64", ("darwin", "x86_64"): "darwin64", ("darwin", "arm64"): "darwin64"},
    3: {("linux", "x86_64"): "x86_64-linux", ("linux", "aarch64"): "aarch64-linux",
        ("darwin", "x86_64"): "x86_64-darwin", ("darwin", "arm64"): "aarch64-darwin"},
}  # fmt: skip
"""By version, system and processor: the standard's name of its folder."""


@dataclass(frozen=True)
class Variable:
    """One of the unit's variables: name, number, causality, kind, unit; inputs start at 0."""

    name: str
    number: int
    output: bool
    unit: str
    kind: str = "Real"

    def xml(self, version: int) -> str:
        """As a line of modelDescription.xml."""
        how = 'causality="output" initial="calculated"' if self.output else 'causality="input"'
        how += ' variability="discrete"' if self.kind == "Integer" else ""
        value = "" if self.output else ' start="0"'
        unit = f" unit={quoteattr(self.unit)}" if self.unit else ""
        head = f"name={quoteattr(self.name)} valueReference={quoteattr(str(self.number))} {how}"
        if version == 3:
            kind = {"Real": "Float64", "Integer": "Int32"}[self.kind]
            return f"  <{kind} {head}{value}{unit}/>"
        return f"  <ScalarVariable {head}><{self.kind}{value}{unit}/></ScalarVariable>"


def unit(mechanism: Mechanism, charts: Sequence[Sequence[str]], step: float, version: int) -> bytes:
    """The bytes of an .fmu file.

    Raises
    ------
    ModelError
        As `described`, and on systems that the standard has no folder for.
    """
    mechanism_file = described(mechanism, charts)
    system = sys.platform, platform.machine()
    if system not in FOLDERS[version]:
        raise ModelError(
            f"export: FMI {version}.0 has no folder for {system[1]} under {system[0]}; export .rgcp there"
        )
    folder, binary = FOLDERS[version][system], kernel_file()
    name = identifier(mechanism.name or "mechanism")
    digest = hashlib.sha256(mechanism_file).hexdigest()[:32]
    files: dict[str, bytes] = {
        "modelDescription.xml": _description(mechanism, name, digest, step, version).encode(),
        f"binaries/{folder}/{name}{binary.suffix}": binary.read_bytes(),
        "resources/mechanism.rgcp": mechanism_file,
        "resources/step.txt": f"{step!r}\n".encode(),
    }
    raw = io.BytesIO()
    with zipfile.ZipFile(raw, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in files.items():
            # one date for all: the same mechanism gives the same bytes
            archive.writestr(zipfile.ZipInfo(path, (2026, 1, 1, 0, 0, 0)), data, zipfile.ZIP_DEFLATED)
    return raw.getvalue()


def variables(mechanism: Mechanism) -> Iterator[Variable]:
    """Inputs `tau.JOINT`, `ctrl.ACTUATOR`; outputs `q.JOINT`, `v.JOINT`, `crossings`; [k] where several."""
    rotates = mechanism.tree.rotates
    for joint in mechanism.joints:
        for k in range(joint.nv):
            at, name = joint.idx_v + k, joint.name + (f"[{k + 1}]" if joint.nv > 1 else "")
            yield Variable(f"tau.{name}", INPUT + at, False, "N.m" if rotates[at] else "N")
            yield Variable(f"v.{name}", V + at, True, "rad/s" if rotates[at] else "m/s")
        for k in range(joint.nq):
            name = joint.name + (f"[{k + 1}]" if joint.nq > 1 else "")
            length = "rad" if rotates[joint.idx_v] else "m"
            yield Variable(
                f"q.{name}", Q + joint.idx_q + k, True, length if joint.nq == joint.nv == 1 else ""
            )
    for k, actuator in enumerate(mechanism.actuators):
        yield Variable(f"ctrl.{actuator.name}", CONTROL + k, False, "")
    yield Variable("crossings", CROSSINGS, True, "", "Integer")


def _description(mechanism: Mechanism, name: str, digest: str, step: float, version: int) -> str:
    """The text of modelDescription.xml."""
    listed = list(variables(mechanism))
    units = "".join(f"<Unit name={quoteattr(text)}/>" for text in sorted({v.unit for v in listed} - {""}))
    words = quoteattr(mechanism.name or name)
    lines = "\n".join(variable.xml(version) for variable in listed)
    token, state = ("guid", "FMUstate") if version == 2 else ("instantiationToken", "FMUState")
    can = f'canGetAndSet{state}="true" canSerialize{state}="true"'
    if version == 2:
        unknown = "".join(f'<Unknown index="{i}"/>' for i, v in enumerate(listed, 1) if v.output)
        structure = f"<Outputs>{unknown}</Outputs><InitialUnknowns>{unknown}</InitialUnknowns>"
    else:
        lines += f'\n  <Float64 name="time" valueReference="{TIME}" causality="independent"/>'
        structure = "".join(
            f'<{what} valueReference="{v.number}"/>'
            for what in ("Output", "InitialUnknown")
            for v in listed
            if v.output
        )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="{version}.0" modelName={words} {token}="{{{digest}}}" \
generationTool="robust_gcp" variableNamingConvention="flat">
 <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true" {can}/>
 <UnitDefinitions>{units}</UnitDefinitions>
 <DefaultExperiment startTime="0" stopTime="5" stepSize="{step!r}"/>
 <ModelVariables>
{lines}
 </ModelVariables>
 <ModelStructure>{structure}</ModelStructure>
</fmiModelDescription>
"""
