#include "content/read/mesh_stream.hpp"

#include <bit>
#include <cmath>
#include <cstring>

#include "engine/base/error.hpp"
namespace trocar {
namespace {

static_assert(std::endian::native == std::endian::little);
static_assert(sizeof(Vec3d) == 24 && sizeof(Triangle) == 12 && sizeof(std::array<Vec2, 3>) == 24);

constexpr std::string_view kMagic = "trocar mesh 1\n";

template <typename Value>
void put(std::string& out, const Value& value) {
    out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

template <typename Row>
void put_rows(std::string& out, const std::vector<Row>& rows) {
    out.append(reinterpret_cast<const char*>(rows.data()), rows.size() * sizeof(Row));
}

void put_text(std::string& out, std::string_view text) {
    put(out, uint64_t{text.size()});
    out += text;
}

// The unread bytes.
struct Bytes {
    std::string_view rest;

    std::string_view take(uint64_t count, const char* what) {
        if (count > rest.size()) throw InputError(std::string("the reader's answer ends within its ") + what);
        const std::string_view taken = rest.substr(0, count);
        rest.remove_prefix(count);
        return taken;
    }
    template <typename Value>
    Value value(const char* what) {
        Value value;
        std::memcpy(&value, take(sizeof value, what).data(), sizeof value);
        return value;
    }
    template <typename Row>
    void rows(std::vector<Row>& rows, uint64_t count, const char* what) {
        if (count > rest.size() / sizeof(Row)) throw InputError(std::string("the reader's answer ends within its ") + what);
        rows.resize(count);
        if (count > 0) std::memcpy(static_cast<void*>(rows.data()), take(count * sizeof(Row), what).data(), count * sizeof(Row));
    }
    std::string text(const char* what) { return std::string(take(value<uint64_t>(what), what)); }
};

void check_rows(const Mesh& mesh) {
    if (mesh.position.size() >= kNone || mesh.triangle.size() >= kNone / 3) {
        throw InputError("more vertices or faces than 32 bits can number");
    }
    for (size_t v = 0; v < mesh.position.size(); ++v) {
        if (!mesh.position[v].allFinite()) throw InputError("vertex " + std::to_string(v) + " is not finite");
    }
    for (size_t t = 0; t < mesh.triangle.size(); ++t) {
        for (const uint32_t v : mesh.triangle[t]) {
            if (v < mesh.position.size()) continue;
            throw InputError("face " + std::to_string(t) + " names vertex " + std::to_string(v) + " of " +
                             std::to_string(mesh.position.size()));
        }
    }
    for (const auto& corners : mesh.uv) {
        for (const Vec2& uv : corners) {
            if (!std::isfinite(uv.u) || !std::isfinite(uv.v)) throw InputError("a texture coordinate is not finite");
        }
    }
    for (const uint16_t row : mesh.triangle_material) {
        if (row >= mesh.material.size()) throw InputError("a face names material " + std::to_string(row));
    }
}

Material read_material(Bytes& bytes, std::string& picture) {
    Material material;
    material.name = bytes.text("materials");
    material.texture = bytes.text("materials");
    picture = bytes.text("materials");
    const auto look = bytes.value<std::array<float, 8>>("materials");
    for (const float value : look) {
        if (!(value >= 0 && value <= 1)) throw InputError("material '" + material.name + "' is not within 0..1");
    }
    for (size_t c = 0; c < 3; ++c) {
        material.diffuse[c] = look[c];
        material.specular[c] = look[3 + c];
    }
    material.shininess = look[6];
    material.transparency = look[7];
    return material;
}

}  // namespace

std::string encode_mesh_stream(const MeshStream& stream) {
    const Mesh& mesh = stream.mesh;
    std::string out(kMagic);
    out.reserve(256 + 24 * mesh.position.size() + 12 * mesh.triangle.size() + 24 * mesh.uv.size() + 2 * mesh.triangle_material.size());
    for (const uint64_t count : {mesh.position.size(), mesh.triangle.size(), mesh.uv.size(), mesh.triangle_material.size(),
                                 mesh.material.size(), stream.warnings.size()}) {
        put(out, count);
    }
    put_rows(out, mesh.position);
    put_rows(out, mesh.triangle);
    put_rows(out, mesh.uv);
    put_rows(out, mesh.triangle_material);
    for (size_t m = 0; m < mesh.material.size(); ++m) {
        const Material& material = mesh.material[m];
        put_text(out, material.name);
        put_text(out, material.texture);
        put_text(out, m < stream.picture.size() ? stream.picture[m] : std::string());
        put(out, material.diffuse);
        put(out, material.specular);
        put(out, material.shininess);
        put(out, material.transparency);
    }
    put_text(out, stream.format);
    for (const std::string& warning : stream.warnings) put_text(out, warning);
    return out;
}

MeshStream decode_mesh_stream(std::string_view whole) {
    Bytes bytes{whole};
    if (!whole.starts_with(kMagic)) throw InputError("the reader's answer is not one of its kind");
    bytes.take(kMagic.size(), "name");
    MeshStream stream;
    Mesh& mesh = stream.mesh;
    const auto counts = bytes.value<std::array<uint64_t, 6>>("counts");
    const auto [vertices, triangles, uv_rows, material_rows, materials, warnings] = counts;
    if ((uv_rows != 0 && uv_rows != triangles) || (material_rows != 0 && material_rows != triangles)) {
        throw InputError("the reader's answer has rows for another number of faces");
    }
    bytes.rows(mesh.position, vertices, "vertices");
    bytes.rows(mesh.triangle, triangles, "faces");
    bytes.rows(mesh.uv, uv_rows, "texture coordinates");
    bytes.rows(mesh.triangle_material, material_rows, "material rows");
    if (materials > 65535) throw InputError("more than 65535 materials");
    for (uint64_t m = 0; m < materials; ++m) {
        stream.picture.emplace_back();
        mesh.material.push_back(read_material(bytes, stream.picture.back()));
    }
    stream.format = bytes.text("format");
    if (warnings > bytes.rest.size()) throw InputError("the reader's answer ends within its warnings");
    for (uint64_t w = 0; w < warnings; ++w) stream.warnings.push_back(bytes.text("warnings"));
    if (!bytes.rest.empty()) throw InputError("the reader's answer goes on after its end");
    check_rows(mesh);
    return stream;
}

}  // namespace trocar
