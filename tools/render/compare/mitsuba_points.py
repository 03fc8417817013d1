#!/usr/bin/env python3
"""Light at the points of a reference CSV, path-traced by Mitsuba: another opinion with as little noise as one has time for.

Where our path tracer and a reference file differ, this says whose light it is. Scenes of diffuse base colours and
one texture each, under a constant sky and lights without size: what else a file has is refused, not left out.

    pip install mitsuba numpy pillow
    python3 tools/render/compare/mitsuba_points.py SCENE.glb LIGHTS.json POINTS.csv OUT.csv --paths 1048576
    earthshine bench reference --scene SCENE.glb --lights LIGHTS.json --reference OUT.csv --noise 0 --paths 131072
"""

import argparse
import csv
import io
import json
import os
import struct
import sys
import tempfile

try:
    import mitsuba as mi
    import numpy as np
    from PIL import Image
except ImportError as missing:
    sys.exit(f"error: {missing.name} is not installed: pip install mitsuba numpy pillow")

mi.set_variant("scalar_rgb")

COMPONENTS = {5121: "u1", 5123: "u2", 5125: "u4", 5126: "f4"}
ATTRIBUTES = {"POSITION", "NORMAL", "TANGENT", "TEXCOORD_0"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
# Pixels of a meter's film: their means tell the noise.
FILM = 16
# Edge of the black square that measures at a point, m.
METER_M = 2e-4


def refuse(cause):
    sys.exit(f"error: {cause}")


class Glb:
    """The parts of a .glb file that diffuse light depends on."""

    def __init__(self, path):
        data = open(path, "rb").read()
        if data[:4] != b"glTF":
            refuse(f"{path} is no .glb file")
        length = struct.unpack("<I", data[12:16])[0]
        self.json = json.loads(data[20 : 20 + length])
        self.bytes = data[28 + length :]
        unknown = set(self.json.get("extensionsUsed", [])) - {"KHR_lights_punctual"}
        if unknown:
            refuse(f"{path} uses {', '.join(sorted(unknown))}")

    def view(self, index):
        view = self.json["bufferViews"][index]
        return view.get("byteOffset", 0), view

    def numbers(self, index):
        accessor = self.json["accessors"][index]
        if accessor.get("normalized") or "sparse" in accessor or accessor["componentType"] not in COMPONENTS:
            refuse(f"accessor {index} is normalized, sparse or of signed integers")
        kind, width = np.dtype("<" + COMPONENTS[accessor["componentType"]]), WIDTHS[accessor["type"]]
        start, view = self.view(accessor["bufferView"])
        start += accessor.get("byteOffset", 0)
        stride = view.get("byteStride", kind.itemsize * width)
        shape, strides = (accessor["count"], width), (stride, kind.itemsize)
        return np.ndarray(shape, kind, self.bytes, start, strides)

    def image(self, index):
        image = self.json["images"][index]
        start, view = self.view(image["bufferView"])
        return Image.open(io.BytesIO(self.bytes[start : start + view["byteLength"]])).convert("RGB")

    def triangles(self):
        """Corners (m) and texture coordinates of all triangles, by material."""
        found = {}

        def walk(index, above):
            node = self.json["nodes"][index]
            matrix = above @ placed(node)
            if "mesh" in node:
                for part in self.json["meshes"][node["mesh"]]["primitives"]:
                    if part.get("mode", 4) != 4 or "material" not in part or "targets" in part or "skin" in node:
                        refuse(f"mesh {node['mesh']} is not of triangles with a material that stand still")
                    if set(part["attributes"]) - ATTRIBUTES:
                        refuse(f"mesh {node['mesh']} has more than {', '.join(sorted(ATTRIBUTES))}")
                    corners = self.numbers(part["attributes"]["POSITION"]).astype("f8")
                    order = self.numbers(part["indices"])[:, 0] if "indices" in part else np.arange(len(corners))
                    uv = part["attributes"].get("TEXCOORD_0")
                    uv = np.zeros((len(corners), 2)) if uv is None else self.numbers(uv)
                    corners = corners[order] @ matrix[:3, :3].T + matrix[:3, 3]
                    found.setdefault(part["material"], []).append((corners, uv[order]))
            for child in node.get("children", []):
                walk(child, matrix)

        for root in self.json["scenes"][self.json.get("scene", 0)]["nodes"]:
            walk(root, np.eye(4))
        join = lambda parts: tuple(np.concatenate(which) for which in zip(*parts))
        return {material: join(parts) for material, parts in found.items()}


def placed(node):
    """A node's matrix."""
    if "matrix" in node:
        return np.array(node["matrix"], "f8").reshape(4, 4).T
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    turned = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])
    matrix = np.eye(4)
    matrix[:3, :3] = turned * np.array(node.get("scale", [1, 1, 1]))
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def write_ply(path, corners, uv):
    vertices = np.concatenate([corners, uv], 1).astype("<f4")
    faces = np.zeros(len(corners) // 3, [("n", "u1"), ("corners", "<i4", 3)])
    faces["n"], faces["corners"] = 3, np.arange(len(corners)).reshape(-1, 3)
    names = "".join(f"property float {name}\n" for name in "xyzuv")
    with open(path, "wb") as file:
        file.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{names}".encode())
        file.write(f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n".encode())
        file.write(vertices.tobytes())
        file.write(faces.tobytes())


def diffuse(glb, index, folder):
    """A material that reflects its base colour from both sides."""
    material = glb.json["materials"][index]
    name, pbr = material.get("name", index), material.get("pbrMetallicRoughness", {})
    if material.get("alphaMode", "OPAQUE") != "OPAQUE" or any(material.get("emissiveFactor", [])):
        refuse(f"material {name} has holes or emits")
    if pbr.get("metallicFactor", 1) != 0:
        refuse(f"material {name} is a metal")
    factor = pbr.get("baseColorFactor", [1, 1, 1, 1])[:3]
    reflectance = {"type": "rgb", "value": factor}
    if "baseColorTexture" in pbr:
        texture = pbr["baseColorTexture"]
        if factor != [1, 1, 1] or texture.get("texCoord", 0) != 0 or "extensions" in texture:
            refuse(f"material {name} has a texture with a factor, a transform or other coordinates")
        texture = glb.json["textures"][texture["index"]]
        sampler = glb.json["samplers"][texture["sampler"]] if "sampler" in texture else {}
        if {sampler.get("wrapS", 10497), sampler.get("wrapT", 10497)} != {10497} or sampler.get("magFilter") == 9728:
            refuse(f"material {name} has a texture that does not tile, or is not interpolated")
        path = os.path.join(folder, f"{index}.png")
        glb.image(texture["source"]).save(path)
        reflectance = {"type": "bitmap", "filename": path, "filter_type": "bilinear", "wrap_mode": "repeat"}
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": reflectance}}


def lit(path):
    """Mitsuba's emitters of a lights file."""
    rig = json.load(open(path))
    if rig.get("use_gltf_lights", True) or set(rig) - {"sky", "lights", "use_gltf_lights"}:
        refuse(f"{path}: only `sky` and `lights`, and `use_gltf_lights` false")
    emitters = {}
    if "sky" in rig:
        if set(rig["sky"]) != {"color"}:
            refuse(f"{path}: a sky of one `color` only")
        emitters["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": rig["sky"]["color"]}}
    for at, light in enumerate(rig.get("lights", [])):
        if light["type"] != "directional" or set(light) - {"type", "direction", "color", "intensity"}:
            refuse(f"{path}: light {at} is not a directional one without size")
        irradiance = [light["intensity"] * channel for channel in light.get("color", [1, 1, 1])]
        emitters[f"light{at}"] = {
            "type": "directional",
            "direction": light["direction"],
            "irradiance": {"type": "rgb", "value": irradiance},
        }
    return emitters


def meter(at, place, normal):
    """A black square at `place` that measures what arrives."""
    up = [0, 0, 1] if abs(normal[1]) > 0.5 else [0, 1, 0]
    facing = mi.ScalarTransform4f().look_at(list(place), list(place + normal), up)
    film = {"type": "hdrfilm", "width": FILM, "height": FILM, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    # Meters that are described alike would be one and the same.
    sampler = {"type": "independent", "seed": at}
    return {
        "type": "rectangle",
        "to_world": facing @ mi.ScalarTransform4f().scale(METER_M / 2),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
        "sensor": {"type": "irradiancemeter", "sampler": sampler, "film": film},
    }


def measured(scene, points, paths):
    """Mean light and its standard error at each of `points`, lx."""
    integrator = mi.load_dict({"type": "path", "max_depth": -1, "rr_depth": 16})
    # Mitsuba keeps sensors in an order of its own.
    places = [np.array(sensor.get_shape().bbox().center()) for sensor in scene.sensors()]
    for at, (place, _) in enumerate(points):
        nearest = int(np.argmin([np.linalg.norm(other - place) for other in places]))
        spp = max(paths // FILM**2, 1)
        film = mi.render(scene, sensor=nearest, spp=spp, integrator=integrator, seed=at)
        pixels = np.array(film, "f8").reshape(-1, 3)
        print(f"\r{at + 1} of {len(points)} points", end="", file=sys.stderr)
        yield pixels.mean(0), pixels.std(0, ddof=1) / FILM
    print(file=sys.stderr)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("lights")
    parser.add_argument("points", help="any CSV whose first six columns are x,y,z,nx,ny,nz")
    parser.add_argument("out")
    parser.add_argument("--paths", type=int, default=1 << 20, help="paths a point (%(default)s)")
    arguments = parser.parse_args()
    rows = list(csv.reader(open(arguments.points)))[1:]
    points = [(np.array(row[:3], "f8"), np.array(row[3:6], "f8")) for row in rows]
    for at, (place, _) in enumerate(points):
        if any(np.linalg.norm(place - before) < 10 * METER_M for before, _ in points[:at]):
            refuse(f"point {at + 1} is where another one is: their meters would stand in each other's light")
    glb = Glb(arguments.scene)
    with tempfile.TemporaryDirectory() as folder:
        whole = {"type": "scene", **lit(arguments.lights)}
        for material, (corners, uv) in glb.triangles().items():
            path = os.path.join(folder, f"{material}.ply")
            write_ply(path, corners, uv)
            bsdf = diffuse(glb, material, folder)
            whole[f"mesh{material}"] = {"type": "ply", "filename": path, "face_normals": True, "bsdf": bsdf}
        for at, (place, normal) in enumerate(points):
            whole[f"meter{at}"] = meter(at, place, normal)
        lights = list(measured(mi.load_dict(whole), points, arguments.paths))
    with open(arguments.out, "w") as file:
        file.write("x,y,z,nx,ny,nz,r,g,b,sr,sg,sb\n")
        for (place, normal), (light, error) in zip(points, lights):
            file.write(",".join(f"{number:.9g}" for number in [*place, *normal, *light, *error]) + "\n")


if __name__ == "__main__":
    main()
