#include "systems/app/commands/cells_file.hpp"

#include <nlohmann/json.hpp>
#include <numbers>

#include "engine/base/error.hpp"
#include "engine/base/format.hpp"
#include "engine/files/image_file.hpp"
#include "engine/files/whole_file.hpp"
#include "engine/mesh/surfaces.hpp"
#include "systems/app/pictures/mesh_picture.hpp"
namespace trocar {
namespace {

std::array<uint32_t, 3> unpack_cell(uint64_t key) {
    constexpr uint64_t kMask = (1 << 21) - 1;
    return {uint32_t(key >> 42 & kMask), uint32_t(key >> 21 & kMask), uint32_t(key & kMask)};
}

// Corner k of a cell: bits 0, 1, 2 of k select the upper end in x, y, z.
Vec3d corner_of(const Occupancy& o, uint32_t cell, uint32_t k, double shrink) {
    const auto at = unpack_cell(o.cell_key[cell]);
    Vec3d p;
    for (uint32_t d = 0; d < 3; ++d) p[d] = at[d] + 0.5 + 0.5 * shrink * ((k >> d & 1) ? 1 : -1);
    return o.origin + o.cell_size * p;
}

constexpr uint32_t kFaces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};

uint32_t objects_of(const Occupancy& o, uint32_t cell) { return o.object_first[cell + 1] - o.object_first[cell]; }
uint32_t primitives_of(const Occupancy& o, uint32_t cell) {
    return o.primitive_first[o.object_first[cell + 1]] - o.primitive_first[o.object_first[cell]];
}

std::string layers_as_json(const World& world) {
    using json = nlohmann::ordered_json;
    const Occupancy& o = world.occupancy;
    json cells = json::array();
    for (uint32_t cell = 0; cell < o.cell_key.size(); ++cell) {
        json objects = json::array();
        for (uint32_t i = o.object_first[cell]; i < o.object_first[cell + 1]; ++i) {
            const auto begin = o.primitive.begin();
            objects.push_back({{"body", o.object[i]},
                               {"triangles", std::vector<uint32_t>(begin + o.primitive_first[i], begin + o.primitive_first[i + 1])}});
        }
        cells.push_back({{"cell", unpack_cell(o.cell_key[cell])}, {"objects", objects}});
    }
    json large = json::array();
    for (uint32_t body = 0; body < world.screened.body.size(); ++body) {
        const Range rows = world.screened.body[body];
        for (const uint32_t row : o.oversize) {
            if (row >= rows.first && row < rows.end()) large.push_back({{"body", body}, {"triangle", world.screened.triangle[row]}});
        }
    }
    const json j = {{"bodies", world.bodies.name},
                    {"cell_size", o.cell_size},
                    {"origin", {o.origin.x(), o.origin.y(), o.origin.z()}},
                    {"cells", cells},
                    {"oversize", large}};
    return j.dump() + "\n";
}

std::string layers_as_vtp(const Occupancy& o) {
    const uint32_t cells = uint32_t(o.cell_key.size());
    std::string out =
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"LittleEndian\">\n"
        "<PolyData>\n<Piece NumberOfPoints=\"" +
        std::to_string(8 * cells) + "\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"" +
        std::to_string(6 * cells) + "\">\n<CellData>\n";
    const auto array = [&](const char* type, const char* name, uint32_t components, uint32_t rows, const auto& row) {
        out += std::string("<DataArray type=\"") + type + "\" Name=\"" + name + "\" NumberOfComponents=\"" + std::to_string(components) +
               "\" format=\"ascii\">\n";
        for (uint32_t i = 0; i < rows; ++i) out += row(i) + "\n";
        out += "</DataArray>\n";
    };
    array("Int32", "objects", 1, 6 * cells, [&](uint32_t i) { return std::to_string(objects_of(o, i / 6)); });
    array("Int32", "primitives", 1, 6 * cells, [&](uint32_t i) { return std::to_string(primitives_of(o, i / 6)); });
    out += "</CellData>\n<Points>\n";
    array("Float64", "Points", 3, 8 * cells, [&](uint32_t i) {
        const Vec3d p = corner_of(o, i / 8, i % 8, 1);
        return format("%.17g %.17g %.17g", p.x(), p.y(), p.z());
    });
    out += "</Points>\n<Polys>\n";
    array("Int32", "connectivity", 1, 6 * cells, [&](uint32_t i) {
        std::string row;
        for (const uint32_t k : kFaces[i % 6]) row += std::to_string(8 * (i / 6) + k) + " ";
        return row;
    });
    array("Int32", "offsets", 1, 6 * cells, [](uint32_t i) { return std::to_string(4 * (i + 1)); });
    return out + "</Polys>\n</Piece>\n</PolyData>\n</VTKFile>\n";
}

Material colour(const char* name, float r, float g, float b) {
    Material m;
    m.name = name;
    m.diffuse = {r, g, b};
    return m;
}

// All bodies in their current positions. Even materials plain; odd ones: triangles in a shared cell.
Mesh bodies_mesh(const World& world) {
    Mesh mesh;
    mesh.name = "bodies, bright: triangles in shared cells";
    mesh.material = {colour("a", 0.55f, 0.42f, 0.36f), colour("a shared", 0.95f, 0.45f, 0.08f), colour("b", 0.36f, 0.45f, 0.55f),
                     colour("b shared", 0.15f, 0.45f, 0.95f)};
    const Occupancy& o = world.occupancy;
    for (uint32_t body = 0; body < world.bodies.mesh.size(); ++body) {
        const MeshView view = mesh_view(world.meshes, world.bodies.mesh[body]);
        std::vector<uint8_t> shared(view.triangle.size(), 0);
        for (uint32_t i = 0; i < o.object.size(); ++i) {
            if (o.object[i] != body) continue;
            for (uint32_t p = o.primitive_first[i]; p < o.primitive_first[i + 1]; ++p) shared[o.primitive[p]] = 1;
        }
        const uint32_t first = uint32_t(mesh.position.size());
        for (uint32_t v = 0; v < view.position.size(); ++v) mesh.position.push_back(vertex_position(surfaces_of(world), body, v));
        for (uint32_t t = 0; t < view.triangle.size(); ++t) {
            const Triangle& c = view.triangle[t];
            mesh.triangle.push_back({first + c[0], first + c[1], first + c[2]});
            mesh.triangle_material.push_back(uint16_t(2 * (body % 2) + shared[t]));
        }
    }
    return mesh;
}

// One box per shared cell, shrunk to be distinguishable; red if it holds more primitives than average.
Mesh cells_mesh(const Occupancy& o) {
    const double mean = double(o.primitive.size()) / double(o.cell_key.size());
    Mesh mesh;
    mesh.name = "shared cells, red: more triangles than average";
    mesh.material = {colour("few", 0.9f, 0.7f, 0.2f), colour("many", 0.8f, 0.15f, 0.1f)};
    for (uint32_t cell = 0; cell < o.cell_key.size(); ++cell) {
        for (uint32_t k = 0; k < 8; ++k) mesh.position.push_back(corner_of(o, cell, k, 0.85));
        for (const auto& f : kFaces) {
            const uint32_t first = 8 * cell;
            mesh.triangle.push_back({first + f[0], first + f[1], first + f[2]});
            mesh.triangle.push_back({first + f[0], first + f[2], first + f[3]});
            mesh.triangle_material.insert(mesh.triangle_material.end(), 2, primitives_of(o, cell) > mean);
        }
    }
    return mesh;
}

Image draw_cells(const World& world) {
    std::vector<Mesh> meshes{bodies_mesh(world)};
    if (!world.occupancy.cell_key.empty()) meshes.push_back(cells_mesh(world.occupancy));
    std::vector<MeshTile> tiles;
    for (uint32_t i = 0; i < meshes.size(); ++i) {
        tiles.push_back({i, -60 * std::numbers::pi / 180, 28 * std::numbers::pi / 180, meshes[i].name});
    }
    MeshPictureParams params;
    params.width = 1600;
    params.height = 700;
    return draw_meshes(params, meshes, tiles);
}

}  // namespace

void write_cells(const World& world, const std::filesystem::path& path) {
    const std::string ending = path.extension().string();
    if (ending == ".json") return write_whole_file(path, layers_as_json(world));
    if (ending == ".vtp") return write_whole_file(path, layers_as_vtp(world.occupancy));
    if (ending == ".png") return save_png(draw_cells(world), path);
    throw InputError(path.string() + ": the name must end in .json, .vtp or .png");
}

}  // namespace trocar
