#include "mutate/mutants.hpp"

#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <random>

#include "content/mend/clean_mesh.hpp"
#include "content/mend/repair_mesh.hpp"
#include "content/read/load_mesh.hpp"
#include "content/scene/build_scene.hpp"
#include "content/write/save_mesh.hpp"
#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/files/capture_file.hpp"
#include "engine/files/state_hash.hpp"
#include "engine/files/text_file.hpp"
#include "engine/world/world.hpp"
#include "reference/sample_meshes.hpp"
namespace trocar::mutate {
namespace {

namespace fs = std::filesystem;
using Random = std::mt19937_64;

constexpr const char* kVrml1 = R"(#VRML V1.0 ascii
DEF Root Separator {
  ShapeHints { vertexOrdering COUNTERCLOCKWISE faceType CONVEX creaseAngle 0.5 }
  Material { diffuseColor [ 0.8 0.2 0.1, 0.1 0.2 0.8 ] transparency 0.25 }
  MaterialBinding { value PER_FACE_INDEXED }
  Transform { translation 1 2 3 rotation 0 0 1 0.5 scaleFactor 2 2 2 }
  Coordinate3 { point [ 0 0 0, 1 0 0, 0 1 0, 0 0 1, 1 1 0 ] }
  TextureCoordinate2 { point [ 0 0, 1 0, 0 1, 1 1 ] }
  IndexedFaceSet { coordIndex [ 0, 2, 1, -1, 0, 1, 3, -1, 1, 2, 3, -1, 0, 3, 2, -1 ] materialIndex [ 0, 1, 0, 1 ] }
  Separator { MatrixTransform { matrix 1 0 0 0 0 1 0 0 0 0 1 0 5 0 0 1 } Cube { width 2 height 1 depth 3 } Sphere { radius 1 } }
  Switch { whichChild 0 Cone { bottomRadius 1 height 2 } }
  Texture2 { image 2 2 3 0xff0000 0x00ff00 0x0000ff 0xffffff }
  Unknown { field "a \" b" inner { x 1 } }
  USE Root2
}
)";

constexpr const char* kVrml2 = R"(#VRML V2.0 utf8
PROTO Part [ field SFVec3f at 0 0 0  exposedField MFInt32 faces [ 0 2 1 -1 0 1 3 -1 1 2 3 -1 0 3 2 -1 ] ] {
  Transform { translation IS at children Shape {
    appearance Appearance { material DEF M Material { diffuseColor 1 0 0 } texture PixelTexture { image 1 2 1 0x00 0xFF } }
    geometry IndexedFaceSet { coord DEF C Coordinate { point [ 0 0 0 1 0 0 0 1 0 0 0 1 ] } coordIndex IS faces
      texCoord TextureCoordinate { point [ 0 0 1 0 0 1 ] } texCoordIndex [ 0 1 2 -1 0 1 2 -1 0 1 2 -1 0 1 2 -1 ] creaseAngle 1 } } }
}
Group { children [
  Part { at 1 2 3 }
  Transform { rotation 0 1 0 1.57 scale 1 2 3 scaleOrientation 1 0 0 0.3 center 1 1 1 children Shape { geometry Box { size 1 2 3 } } }
  LOD { range [ 10 ] level [ Shape { geometry Cylinder { radius 1 height 2 } } Shape { geometry Sphere { radius 2 } } ] }
  Shape { geometry Extrusion { crossSection [ 1 1, 1 -1, -1 -1, -1 1, 1 1 ] spine [ 0 0 0, 0 1 0, 0 2 1 ] scale [ 1 1, 2 1 ] } }
  Shape { geometry ElevationGrid { xDimension 3 zDimension 2 xSpacing 1 zSpacing 2 height [ 0 1 0 2 1 0 ] } }
] }
ROUTE A.b TO C.d
)";

constexpr const char* kX3d = R"(<?xml version="1.0" encoding="UTF-8"?>
<X3D profile="Immersive" version="3.0"><Scene>
<Transform translation="1 2 3" rotation="0 0 1 0.5" DEF="T"><Shape><Appearance><Material diffuseColor="1 0 0"/></Appearance>
<IndexedFaceSet coordIndex="0 2 1 -1 0 1 3 -1 1 2 3 -1 0 3 2 -1" solid="false"><Coordinate point="0 0 0,1 0 0,0 1 0,0 0 1"/>
<TextureCoordinate point="0 0 1 0 0 1 1 1"/></IndexedFaceSet></Shape></Transform>
<Shape><IndexedTriangleSet index="0 1 2 2 3 0"><Coordinate point="0 0 0 1 0 0 1 1 0 0 1 0"/></IndexedTriangleSet></Shape>
<Shape><ElevationGrid xDimension="2" zDimension="2" height="0 1 2 3"/></Shape><Group USE="T"/>
<Shape><Sphere radius="2"/></Shape></Scene></X3D>
)";

constexpr const char* kX3dClassic = R"(#X3D V3.0 utf8
PROFILE Interchange
DEF A Transform { translation 1 0 0 children [ Shape { geometry TriangleStripSet { stripCount [ 4 ] coord Coordinate { point [ 0 0 0 1 0 0 0 1 0 1 1 0 ] } } } ] }
Shape { geometry IndexedFaceSet { coordIndex [ 0 2 1 -1 0 1 3 -1 1 2 3 -1 0 3 2 -1 ] coord Coordinate { point [ 0 0 0 1 0 0 0 1 0 0 0 1 ] } } }
)";

constexpr const char* kObj = R"(# comment
v 0 0 0
v 1 0 0 1.0
v 0 1 0
v 0 0 1
vt 0 0
vt 1 0
vt 0.5 1
vn 0 0 1
g part
s 1
f 1/1/1 3/3/1 2/2/1
f 1//1 2//1 4//1
f -3 -2 -1
f 1 4 3
v 5 0 0
v 6 0 0
v 6 1 0
v 5.5 0.2 0
v 5 1 0
f 5 6 7 \
 8 9
)";

constexpr const char* kPly = R"(ply
format ascii 1.0
comment made
element vertex 4
property float x
property double y
property float z
property uchar red
element face 4
property list uchar int vertex_indices
property list uchar float texcoord
end_header
0 0 0 255
1 0 0 0
0 1 0 0
0 0 1 0
3 0 2 1 6 0 0 1 0 0 1
3 0 1 3 6 0 0 1 0 0 1
3 1 2 3 6 0 0 1 0 0 1
3 0 3 2 6 0 0 1 0 0 1
)";

constexpr const char* kOff = R"(OFF
# comment
5 5 0
0 0 0
1 0 0
1 1 0
0 1 0
0.5 0.5 1
4 0 3 2 1
3 0 1 4 255 0 0
3 1 2 4
3 2 3 4 0.5 0.5 0.5
3 3 0 4
)";

constexpr const char* kVtkHead = "# vtk DataFile Version 3.0\nmutant\n";
constexpr const char* kVtk = R"(ASCII
DATASET POLYDATA
POINTS 5 double
0 0 0 1 0 0 1 1 0
0 1 0 0.5 0.5 1
POLYGONS 5 21
4 0 3 2 1
3 0 1 4
3 1 2 4
3 2 3 4
3 3 0 4
TRIANGLE_STRIPS 1 5
4 0 1 3 2
POINT_DATA 5
SCALARS s float 1
LOOKUP_TABLE default
0 1 2 3 4
)";

constexpr const char* kStl = R"(solid mutant
facet normal 0 0 -1
 outer loop
  vertex 0 0 0
  vertex 0 1 0
  vertex 1 0 0
 endloop
endfacet
facet normal 0 -1 0
 outer loop
  vertex 0 0 0
  vertex 1e0 0 0
  vertex 0 0 1.0
 endloop
endfacet
endsolid mutant
)";

template <typename Value>
void put_big_endian(std::string& out, Value value) {
    char bytes[sizeof value];
    std::memcpy(bytes, &value, sizeof value);
    out.append(std::make_reverse_iterator(bytes + sizeof value), std::make_reverse_iterator(bytes));
}

// Since version 5.1 lists begin with the offset of each cell.
std::string make_newer_vtk(const Mesh& mesh, bool binary) {
    const size_t count = mesh.triangle.size();
    std::string out = std::string(kVtkHead) + (binary ? "BINARY" : "ASCII") + "\nDATASET POLYDATA\nPOINTS " +
                      std::to_string(mesh.position.size()) + " double\n";
    const auto put = [&](auto value) { binary ? put_big_endian(out, value) : void(out += std::to_string(value) + " "); };
    for (const Vec3d& p : mesh.position)
        for (int c = 0; c < 3; ++c) put(p[c]);
    out += "\nPOLYGONS " + std::to_string(count + 1) + " " + std::to_string(3 * count) + "\nOFFSETS vtktypeint64\n";
    for (size_t t = 0; t <= count; ++t) put(static_cast<int64_t>(3 * t));
    out += "\nCONNECTIVITY int\n";
    for (const Triangle& t : mesh.triangle)
        for (const uint32_t v : t) put(static_cast<int32_t>(v));
    return out + "\n";
}

std::string make_binary_vtk(const Mesh& mesh) {
    std::string out = std::string(kVtkHead) + "BINARY\nDATASET POLYDATA\nPOINTS " + std::to_string(mesh.position.size()) + " float\n";
    for (const Vec3d& p : mesh.position) {
        for (int c = 0; c < 3; ++c) put_big_endian(out, static_cast<float>(p[c]));
    }
    out += "\nPOLYGONS " + std::to_string(mesh.triangle.size()) + " " + std::to_string(4 * mesh.triangle.size()) + "\n";
    for (const Triangle& t : mesh.triangle) {
        put_big_endian(out, int32_t{3});
        for (const uint32_t v : t) put_big_endian(out, static_cast<int32_t>(v));
    }
    return out + "\n";
}

size_t below(Random& random, size_t bound) { return bound == 0 ? 0 : random() % bound; }

constexpr const char* kNumbers[] = {
    "0",    "-1",    "1",     "2",   "4",   "255", "65536",      "2147483647", "4294967295", "4294967296", "-2147483648",         "1e9",
    "1e38", "1e300", "1e999", "nan", "inf", "-0",  "0x7fffffff", "0.1e-320",   "1e",         "--3",        "99999999999999999999"};

bool is_number_byte(char c) { return (c >= '0' && c <= '9') || c == '.' || c == '-' || c == '+'; }
bool is_blank(char c) { return c == ' ' || c == '\n' || c == '\t' || c == ',' || c == '\r'; }

constexpr const char* kKnown[] = {
    "bit",  "char",  "unsigned_char", "short",   "unsigned_int", "vtktypeint64", "float",        "double", "string",   "uchar",
    "list", "int8",  "float64",       "ASCII",   "BINARY",       "OFFSETS",      "CONNECTIVITY", "FIELD",  "METADATA", "TRUE",
    "NULL", "DEF",   "USE",           "IS",      "Script",       "UNIT",         "EXPORT",       "AS",     "f",        "vt",
    "o",    "facet", "endsolid",      "element", "end_header",   "PROTO",        "children",     "Inline"};

// The contiguous bytes around a position for which `belongs` is true.
template <typename Belongs>
std::pair<size_t, size_t> run_around(const std::string& bytes, size_t at, const Belongs& belongs) {
    size_t first = at, last = at;
    while (first > 0 && belongs(bytes[first - 1])) --first;
    while (last < bytes.size() && belongs(bytes[last])) ++last;
    return {first, last - first};
}

void edit(std::string& bytes, const std::string& other, Random& random) {
    const size_t at = below(random, bytes.size()), length = 1 + below(random, std::min<size_t>(bytes.size(), 64));
    switch (below(random, 11)) {
        case 0:
            bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(random, 8)));
            break;
        case 1:
            bytes[at] = static_cast<char>(random());
            break;
        case 2:
            if (below(random, 4) == 0) bytes.resize(at + 1);
            break;
        case 3:
            bytes.erase(at, length);
            break;
        case 4:
            bytes.insert(at, bytes.substr(below(random, bytes.size()), length));
            break;
        case 5:
            bytes.insert(at, other.substr(below(random, other.size()), 1 + below(random, other.size())));
            break;
        case 6:
        case 7: {  // replace a number, searched from here on
            size_t from = at;
            while (from < bytes.size() && !is_number_byte(bytes[from])) ++from;
            const auto [first, count] = run_around(bytes, std::min(from, bytes.size()), is_number_byte);
            bytes.replace(first, count, kNumbers[below(random, std::size(kNumbers))]);
            break;
        }
        case 8: {  // duplicate or move a word
            const auto [first, count] = run_around(bytes, at, [](char c) { return !is_blank(c); });
            const std::string word = " " + bytes.substr(first, count) + " ";
            bytes.insert(below(random, 2) == 0 ? first : below(random, bytes.size()), word);
            break;
        }
        case 9: {  // replace a keyword by another format's
            const auto [first, count] = run_around(bytes, at, [](char c) { return !is_blank(c); });
            bytes.replace(first, count, kKnown[below(random, std::size(kKnown))]);
            break;
        }
        default: {
            constexpr uint32_t kWords[] = {0, 1, 0xffffffff, 0x7fffffff, 0x80000000, 0x7f800000, 0x7fc00000, 0xff7fffff, 0x00010000, 3};
            if (bytes.size() < at + 4) break;
            std::memcpy(bytes.data() + at, &kWords[below(random, std::size(kWords))], 4);
        }
    }
    if (bytes.empty()) bytes = "x";
}

void check_result(const Mesh& mesh) {
    TROCAR_ASSERT(!mesh.triangle.empty());
    for (const Vec3d& p : mesh.position) TROCAR_ASSERT(p.allFinite());
    for (const Triangle& t : mesh.triangle) {
        for (const uint32_t v : t) TROCAR_ASSERT(v < mesh.position.size());
    }
    TROCAR_ASSERT(mesh.uv.empty() || mesh.uv.size() == mesh.triangle.size());
    TROCAR_ASSERT(mesh.triangle_material.empty() || mesh.triangle_material.size() == mesh.triangle.size());
    for (const uint16_t row : mesh.triangle_material) TROCAR_ASSERT(row < mesh.material.size());
}

// A scene and a state, as stored in captures.
const std::vector<CaptureRecord>& sound_records() {
    static const std::vector<CaptureRecord> records = [] {
        SceneFile scene;
        for (const double x : {0.0, 0.2}) {
            BodySpec body;
            body.name = "ball" + std::to_string(scene.bodies.size());
            body.shape = "sphere";
            body.triangles = 80;
            body.size = 0.1;
            body.motion = x > 0 ? Motion::kFree : Motion::kDeformable;
            body.position.x() = x;
            scene.bodies.push_back(body);
        }
        const World world = std::move(build_scene(scene, Looks::kPlain).world);
        std::vector<CaptureRecord> made{{"scene", {}}, {"state", {}}};
        for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r) {
            const ResourceKind kind = resource_kind(static_cast<Resource>(r));
            if (kind == ResourceKind::kConstant) save_resource(world, static_cast<Resource>(r), made[0]);
            if (kind == ResourceKind::kState) save_resource(world, static_cast<Resource>(r), made[1]);
        }
        return made;
    }();
    return records;
}

std::string make_capture() {
    const fs::path file = fs::temp_directory_path() / ("trocar_seed_" + std::to_string(::getpid()) + ".cap");
    CaptureWriter writer(file);
    for (const CaptureRecord& record : sound_records()) writer.add(record);
    writer.finish();
    std::string bytes = read_file_bytes(file);
    fs::remove(file);
    return bytes;
}

// Edits data and then updates the hash that protects it: as written by a program that makes wrong captures.
void edit_arrays(std::vector<CaptureRecord>& records, Random& random) {
    for (size_t edits = 1 + below(random, 4); edits > 0; --edits) {
        CaptureRecord& record = records[below(random, records.size())];
        CaptureArray& a = record.arrays[below(random, record.arrays.size())];
        const uint32_t row = static_cast<uint32_t>(a.columns * element_size(a.type));
        if (below(random, 8) == 0) {
            record.arrays.erase(record.arrays.begin() + static_cast<ptrdiff_t>(below(random, record.arrays.size())));
        } else if (below(random, 4) == 0 && a.rows > 0) {
            a.rows = below(random, 2) == 0 ? a.rows - 1 : a.rows + 1;
            a.bytes.resize(a.rows * row);
        } else if (!a.bytes.empty()) {
            constexpr uint64_t kWords[] = {0, ~uint64_t{0}, 0x7ff0000000000000, 0x7fc000007fc00000, 0x0000000100000000, 0x8000000080000000};
            const size_t at = below(random, a.bytes.size()), size = std::min<size_t>(a.bytes.size() - at, 8);
            std::memcpy(a.bytes.data() + at, &kWords[below(random, std::size(kWords))], size);
        }
    }
}

// Reads the records. If the file itself is still valid, damages its arrays instead. A world that loads is
// either reported as faulty or can be simulated: every index in it is checked.
Fate try_capture(const Seed& mutant) {
    const fs::path file = fs::temp_directory_path() / ("trocar_mutant_" + std::to_string(::getpid()) + ".cap");
    {
        std::FILE* out = std::fopen(file.c_str(), "wb");
        TROCAR_ASSERT(out && std::fwrite(mutant.bytes.data(), 1, mutant.bytes.size(), out) == mutant.bytes.size());
        std::fclose(out);
    }
    static const std::string sound = make_capture();
    try {
        CaptureFile read = read_capture(file);
        fs::remove(file);
        StateHash hash;
        hash.add_bytes(mutant.bytes.data(), mutant.bytes.size());
        Random random(hash.value);
        std::vector<CaptureRecord> records = sound_records();
        if (mutant.bytes != sound)
            edit_arrays(records, random);
        else
            records = read.records;
        World world;
        for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r) {
            const ResourceKind kind = resource_kind(static_cast<Resource>(r));
            if (kind == ResourceKind::kConstant) load_resource(records[0], static_cast<Resource>(r), world);
            if (kind == ResourceKind::kState) load_resource(records[1], static_cast<Resource>(r), world);
        }
        return find_fault(world).empty() ? Fate::kRead : Fate::kRefused;
    } catch (const InputError& error) {
        fs::remove(file);
        TROCAR_ASSERT(std::string(error.what()).find('\n') == std::string::npos);
        return Fate::kRefused;
    }
}

}  // namespace

std::vector<Seed> make_seeds() {
    std::vector<Seed> seeds = {{"v1.wrl", kVrml1}, {"v2.wrl", kVrml2}, {"x.x3d", kX3d}, {"x.x3dv", kX3dClassic},
                               {"a.obj", kObj},    {"a.ply", kPly},    {"a.off", kOff}, {"a.vtk", std::string(kVtkHead) + kVtk},
                               {"a.stl", kStl}};
    const Mesh mesh = reference::make_sphere(Vec3d(1, 2, 3), 0.1, 1);
    seeds.push_back({"b.vtk", make_binary_vtk(mesh)});
    seeds.push_back({"c.vtk", make_newer_vtk(mesh, false)});
    seeds.push_back({"d.vtk", make_newer_vtk(mesh, true)});
    const fs::path folder = fs::temp_directory_path() / ("trocar_seeds_" + std::to_string(::getpid()));
    fs::create_directories(folder);
    for (const char* name : {"b.stl", "b.ply", "b.obj", "b.wrl", "b.vtp"}) {
        save_mesh(mesh, folder / name);
        seeds.push_back({name, read_file_bytes(folder / name)});
    }
    fs::remove_all(folder);
    seeds.push_back({"a.cap", make_capture()});
    return seeds;
}

Seed make_mutant(const std::vector<Seed>& seeds, uint64_t number) {
    Random random(number * 0x9e3779b97f4a7c15u + 1);
    Seed mutant = seeds[number % seeds.size()];
    const size_t edits = 1 + below(random, 1 + below(random, 8));  // mostly few: readers get further
    for (size_t k = 0; k < edits; ++k) edit(mutant.bytes, seeds[below(random, seeds.size())].bytes, random);
    return mutant;
}

Fate try_mutant(const Seed& mutant) {
    if (mutant.name.ends_with(".cap")) return try_capture(mutant);
    if (is_input(mutant)) return try_input(mutant);
    try {
        LoadedMesh loaded = load_mesh(mutant.bytes, mutant.name);
        check_result(loaded.mesh);
        Mesh cleaned = loaded.mesh;
        const bool small = loaded.mesh.triangle.size() <= 5000;
        const CleanReport report = clean_mesh(cleaned, {});
        if (report.refused) return Fate::kRefused;  // coordinates beyond the range of contact
        judge_mesh(cleaned, small);
        if (small) {
            RepairParams params;
            params.rounds = 2;
            const RepairReport repaired = repair_mesh(loaded.mesh, params);
            TROCAR_ASSERT(!repaired.solid || repaired.after.admitted_as == Admission::kSolid);
        }
        return Fate::kRead;
    } catch (const InputError& error) {
        const std::string text = error.what();
        TROCAR_ASSERT(text.starts_with(mutant.name) && text.find('\n') == std::string::npos);
        return Fate::kRefused;
    }
}

}  // namespace trocar::mutate
