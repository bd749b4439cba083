#include "content/write/save_mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <map>
#include <span>

#include "content/text/words.hpp"
#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/files/image_file.hpp"
#include "engine/files/whole_file.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

// A text or binary file under construction.
struct Output {
    std::string bytes;

    Output& operator<<(std::string_view text) {
        bytes += text;
        return *this;
    }
    template <typename Number>
    void number(Number value) {
        char text[32];
        bytes.append(text, std::to_chars(text, text + sizeof text, value).ptr);
    }
    void numbers(std::initializer_list<double> values) {
        const char* blank = "";
        for (const double value : values) {
            bytes += blank;
            number(value);
            blank = " ";
        }
    }
    template <typename Value>
    void raw(const Value& value) {
        bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
    }
};

// Writes the number with the fewest digits that identify it in its own type.
void put_float(Output& out, float value) { out.number(value); }

// Keeps letters, digits, '_', '-' and '.' of a name, which every format and file system accepts.
std::string plain_name(std::string_view name, const std::string& otherwise) {
    std::string plain;
    for (const char c : name.substr(0, 80)) {
        const bool keep = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-' || c == '.';
        plain += keep ? c : '_';
    }
    return plain.empty() ? otherwise : plain;
}

// The files of one save: side files first, the mesh last.
using Files = std::vector<std::pair<fs::path, std::string>>;

// Texture file name of each material, empty if none; equal images share a file.
std::vector<std::string> add_textures(const Mesh& mesh, const fs::path& path, Files& files) {
    std::vector<std::string> names;
    for (size_t m = 0; m < mesh.material.size(); ++m) {
        const Material& material = mesh.material[m];
        std::string name = material.texture;
        for (char& c : name) c = static_cast<unsigned char>(c) < ' ' ? '_' : c;
        if (material.image.width > 0) {
            name.clear();
            for (size_t k = 0; k < m && name.empty(); ++k) {
                const Image& other = mesh.material[k].image;
                if (other.width == material.image.width && other.rgba == material.image.rgba) name = names[k];
            }
            if (name.empty()) {
                const std::string suffix = files.empty() ? "" : '_' + std::to_string(files.size());
                name = plain_name(path.stem().string(), "texture") + suffix + ".png";
                const std::vector<std::byte> png = encode_png(material.image);
                files.emplace_back(path.parent_path() / name, std::string(reinterpret_cast<const char*>(png.data()), png.size()));
            }
        }
        names.push_back(name);
    }
    return names;
}

uint16_t material_of(const Mesh& mesh, size_t triangle) {
    return mesh.triangle_material.empty() ? uint16_t{0} : mesh.triangle_material[triangle];
}

// Indexes texture coordinates in order of first use; equal ones share an index.
struct UvTable {
    std::vector<Vec2> uv;
    std::vector<std::array<uint32_t, 3>> index;  // per triangle
};

UvTable number_uv(const Mesh& mesh) {
    UvTable table;
    std::map<std::pair<float, float>, uint32_t> row;
    for (const auto& corners : mesh.uv) {
        std::array<uint32_t, 3> index;
        for (size_t k = 0; k < 3; ++k) {
            const auto next = static_cast<uint32_t>(table.uv.size());
            const auto [found, fresh] = row.try_emplace({corners[k].u, corners[k].v}, next);
            if (fresh) table.uv.push_back(corners[k]);
            index[k] = found->second;
        }
        table.index.push_back(index);
    }
    return table;
}

bool is_plain(const Mesh& mesh) {
    if (mesh.material.size() != 1) return mesh.material.empty();
    const Material& m = mesh.material[0];
    const Material none;
    return m.diffuse == none.diffuse && m.specular == none.specular && m.shininess == none.shininess &&
           m.transparency == none.transparency && m.texture.empty() && m.image.width == 0;
}

std::string material_name(const Mesh& mesh, size_t m) { return plain_name(mesh.material[m].name, "material") + "_" + std::to_string(m); }

std::string write_mtl(const Mesh& mesh, const std::vector<std::string>& textures) {
    Output out;
    for (size_t m = 0; m < mesh.material.size(); ++m) {
        const Material& material = mesh.material[m];
        out << "newmtl " << material_name(mesh, m) << "\n";
        for (const auto& [key, colour] : {std::pair{"Kd", material.diffuse}, {"Ks", material.specular}}) {
            out << key;
            for (const float c : colour) put_float(out << " ", c);
            out << "\n";
        }
        put_float(out << "Ns ", material.shininess * 128);
        put_float(out << "\nd ", 1 - material.transparency);
        out << "\n";
        if (!textures[m].empty()) out << "map_Kd " << textures[m] << "\n";
    }
    return std::move(out.bytes);
}

void write_obj(const Mesh& mesh, const fs::path& path, Files& files) {
    const bool with_materials = !is_plain(mesh);
    Output out;
    if (with_materials) {
        const std::vector<std::string> textures = add_textures(mesh, path, files);
        const std::string name = plain_name(path.stem().string(), "mesh") + ".mtl";
        files.emplace_back(path.parent_path() / name, write_mtl(mesh, textures));
        out << "mtllib " << name << "\n";
    }
    out << "o " << plain_name(mesh.name, "mesh") << "\n";
    for (const Vec3d& p : mesh.position) {
        out << "v ";
        out.numbers({p[0], p[1], p[2]});
        out << "\n";
    }
    const UvTable table = number_uv(mesh);
    for (const Vec2& uv : table.uv) {
        put_float(out << "vt ", uv.u);
        put_float(out << " ", uv.v);
        out << "\n";
    }
    uint32_t material = kNone;
    for (size_t t = 0; t < mesh.triangle.size(); ++t) {
        if (with_materials && material_of(mesh, t) != material) {
            material = material_of(mesh, t);
            out << "usemtl " << material_name(mesh, material) << "\n";
        }
        out << "f";
        for (size_t k = 0; k < 3; ++k) {
            out << " ";
            out.number(mesh.triangle[t][k] + 1);
            if (mesh.uv.empty()) continue;
            out << "/";
            out.number(table.index[t][k] + 1);
        }
        out << "\n";
    }
    files.emplace_back(path, std::move(out.bytes));
}

void write_stl(const Mesh& mesh, const fs::path& path, Files& files) {
    Output out;
    out.bytes.reserve(84 + 50 * mesh.triangle.size());
    // the header must not begin with "solid": some readers would treat the file as text
    std::string header = "binary STL of " + plain_name(mesh.name, "mesh");
    header.resize(80, ' ');
    out << header;
    out.raw(static_cast<uint32_t>(mesh.triangle.size()));
    for (const Triangle& t : mesh.triangle) {
        const Vec3d &a = mesh.position[t[0]], &b = mesh.position[t[1]], &c = mesh.position[t[2]];
        const Vec3d normal = (b - a).cross(c - a);
        std::array<std::array<float, 3>, 4> rows{};  // normal, corners
        for (int i = 0; i < 3; ++i) {
            if (const double length = normal.stableNorm(); length > 0) rows[0][size_t(i)] = static_cast<float>(normal[i] / length);
            for (size_t k = 0; k < 3; ++k) {
                float& number = rows[k + 1][size_t(i)] = static_cast<float>(mesh.position[t[k]][i]);
                if (!std::isfinite(number)) throw InputError(path.string() + ": cannot write: a coordinate is too large for STL");
            }
        }
        out.raw(rows);
        out.raw(uint16_t{0});
    }
    files.emplace_back(path, std::move(out.bytes));
}

void write_ply(const Mesh& mesh, const fs::path& path, Files& files) {
    Output out;
    out << "ply\nformat binary_little_endian 1.0\n";
    const std::vector<std::string> textures = add_textures(mesh, path, files);
    for (const std::string& name : textures) {
        if (!name.empty()) out << "comment TextureFile " << name << "\n";
    }
    out << "element vertex ";
    out.number(mesh.position.size());
    out << "\nproperty double x\nproperty double y\nproperty double z\nelement face ";
    out.number(mesh.triangle.size());
    out << "\nproperty list uchar uint vertex_indices\n";
    if (!mesh.uv.empty()) out << "property list uchar float texcoord\n";
    out << "end_header\n";
    for (const Vec3d& p : mesh.position) {
        for (int c = 0; c < 3; ++c) out.raw(p[c]);
    }
    for (size_t t = 0; t < mesh.triangle.size(); ++t) {
        out.raw(uint8_t{3});
        out.raw(mesh.triangle[t]);
        if (mesh.uv.empty()) continue;
        out.raw(uint8_t{6});
        for (const Vec2& uv : mesh.uv[t]) {
            out.raw(uv.u);
            out.raw(uv.v);
        }
    }
    files.emplace_back(path, std::move(out.bytes));
}

void write_wrl_look(Output& out, const Material& m, const std::string& texture) {
    out << "appearance Appearance { material Material { diffuseColor";
    for (const float c : m.diffuse) put_float(out << " ", c);
    out << " specularColor";
    for (const float c : m.specular) put_float(out << " ", c);
    put_float(out << " shininess ", m.shininess);
    put_float(out << " transparency ", m.transparency);
    out << " }";
    if (!texture.empty()) {
        out << " texture ImageTexture { url \"";
        for (const char c : texture) out << (c == '"' || c == '\\' ? "\\" : "") << std::string_view(&c, 1);
        out << "\" }";
    }
    out << " }";
}

// One Shape per run of triangles with one material, to keep the order of triangles; all share the points.
void write_wrl(const Mesh& mesh, const fs::path& path, Files& files) {
    const std::vector<std::string> textures = add_textures(mesh, path, files);
    const UvTable table = number_uv(mesh);
    Output out;
    out << "#VRML V2.0 utf8\n";
    size_t begin = 0;
    while (begin < mesh.triangle.size()) {
        const uint16_t m = material_of(mesh, begin);
        size_t end = begin;
        while (end < mesh.triangle.size() && material_of(mesh, end) == m) ++end;
        out << "Shape { ";
        if (!mesh.material.empty()) write_wrl_look(out, mesh.material[m], textures[m]);
        out << "\n geometry IndexedFaceSet { solid FALSE coord ";
        if (begin > 0) {
            out << "USE POINTS";
        } else {
            out << "DEF POINTS Coordinate { point [";
            for (const Vec3d& p : mesh.position) {
                out << "\n";
                out.numbers({p[0], p[1], p[2]});
                out << ",";
            }
            out << "] }";
        }
        if (!mesh.uv.empty()) {
            out << "\n texCoord ";
            if (begin > 0) {
                out << "USE UV";
            } else {
                out << "DEF UV TextureCoordinate { point [";
                for (const Vec2& uv : table.uv) {
                    put_float(out << "\n", uv.u);
                    put_float(out << " ", uv.v);
                    out << ",";
                }
                out << "] }";
            }
        }
        const auto write_index = [&](const char* name, std::span<const std::array<uint32_t, 3>> rows) {
            out << "\n " << name << " [";
            for (const auto& row : rows) {
                for (size_t k = 0; k < 3; ++k) {
                    out << (k == 0 ? "\n" : ",");
                    out.number(row[k]);
                }
                out << ",-1,";
            }
            out << "]";
        };
        write_index("coordIndex", std::span(mesh.triangle).subspan(begin, end - begin));
        if (!mesh.uv.empty()) write_index("texCoordIndex", std::span(table.index).subspan(begin, end - begin));
        out << " } }\n";
        begin = end;
    }
    files.emplace_back(path, std::move(out.bytes));
}

// One texture coordinate per vertex if all its corners agree; otherwise empty.
std::vector<Vec2> uv_of_vertices(const Mesh& mesh) {
    std::vector<Vec2> uv(mesh.position.size());
    std::vector<uint8_t> known(mesh.position.size(), 0);
    for (size_t t = 0; t < mesh.uv.size(); ++t) {
        for (size_t k = 0; k < 3; ++k) {
            const uint32_t v = mesh.triangle[t][k];
            const Vec2 corner = mesh.uv[t][k];
            if (known[v] && (uv[v].u != corner.u || uv[v].v != corner.v)) return {};
            uv[v] = corner;
            known[v] = 1;
        }
    }
    return uv;
}

void open_array(Output& out, const char* type, const char* name, int components) {
    out << "<DataArray type=\"" << type << "\" Name=\"" << name << "\" NumberOfComponents=\"";
    out.number(components);
    out << "\" format=\"ascii\">\n";
}

// Writes one number per face as text, from `value`.
template <typename Value>
void put_face_array(Output& out, const char* type, const char* name, size_t faces, const Value& value) {
    open_array(out, type, name, 1);
    for (size_t t = 0; t < faces; ++t) {
        out.number(value(t));
        out << "\n";
    }
    out << "</DataArray>\n";
}

void put_field(Output& out, const PointField& field) {
    open_array(out, "Float32", field.name.c_str(), static_cast<int>(field.components));
    for (size_t i = 0; i < field.values.size(); ++i) {
        put_float(out, field.values[i]);
        out << ((i + 1) % field.components == 0 ? "\n" : " ");
    }
    out << "</DataArray>\n";
}

// VTK's XML PolyData for ParaView, where texture coordinates belong to points. If a seam gives a vertex
// several, they are written as six numbers per face instead.
void write_vtp(const Mesh& mesh, std::span<const PointField> fields, const std::string& note, const fs::path& path, Files& files) {
    Output out;
    out << "<?xml version=\"1.0\"?>\n"
        << (note.empty() ? "" : "<!-- " + note + " -->\n")
        << "<VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"LittleEndian\">\n"
           "<PolyData>\n<Piece NumberOfPoints=\"";
    out.number(mesh.position.size());
    out << "\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"";
    out.number(mesh.triangle.size());
    out << "\">\n";
    const std::vector<Vec2> uv = uv_of_vertices(mesh);
    const bool per_point = !mesh.uv.empty() && !uv.empty();
    if (per_point || !fields.empty()) {
        out << (per_point ? "<PointData TCoords=\"TCoords\">\n" : "<PointData>\n");
        if (per_point) {
            open_array(out, "Float32", "TCoords", 2);
            for (const Vec2& corner : uv) {
                put_float(out, corner.u);
                put_float(out << " ", corner.v);
                out << "\n";
            }
            out << "</DataArray>\n";
        }
        for (const PointField& field : fields) put_field(out, field);
        out << "</PointData>\n";
    }
    out << "<CellData>\n";
    if (!mesh.triangle_material.empty()) {
        put_face_array(out, "Int32", "material", mesh.triangle.size(), [&](size_t t) { return mesh.triangle_material[t]; });
    }
    if (!mesh.uv.empty() && !per_point) {
        open_array(out, "Float32", "texture_coordinates", 6);
        for (const auto& corners : mesh.uv) {
            for (const Vec2& corner : corners) {
                put_float(out, corner.u);
                put_float(out << " ", corner.v);
                out << " ";
            }
            out << "\n";
        }
        out << "</DataArray>\n";
    }
    out << "</CellData>\n<Points>\n";
    open_array(out, "Float64", "Points", 3);
    for (const Vec3d& p : mesh.position) {
        out.numbers({p[0], p[1], p[2]});
        out << "\n";
    }
    out << "</DataArray>\n</Points>\n<Polys>\n";
    open_array(out, "Int64", "connectivity", 1);
    for (const Triangle& t : mesh.triangle) {
        for (size_t k = 0; k < 3; ++k) {
            out.number(t[k]);
            out << (k < 2 ? " " : "\n");
        }
    }
    out << "</DataArray>\n";
    put_face_array(out, "Int64", "offsets", mesh.triangle.size(), [](size_t t) { return 3 * t + 3; });
    out << "</Polys>\n</Piece>\n</PolyData>\n</VTKFile>\n";
    files.emplace_back(path, std::move(out.bytes));
}

}  // namespace

void save_mesh(const Mesh& mesh, const fs::path& path) {
    for (const Triangle& t : mesh.triangle) {
        for (const uint32_t v : t) TROCAR_ASSERT(v < mesh.position.size());
    }
    for (const Vec3d& p : mesh.position) {
        if (!p.allFinite()) throw InputError(path.string() + ": cannot write: a coordinate is not finite");
    }
    TROCAR_ASSERT(mesh.uv.empty() || mesh.uv.size() == mesh.triangle.size());
    TROCAR_ASSERT(mesh.triangle_material.empty() || mesh.triangle_material.size() == mesh.triangle.size());
    for (const uint16_t m : mesh.triangle_material) TROCAR_ASSERT(m < mesh.material.size());
    const std::string extension = lower_case(path.extension().string());
    Files files;
    if (extension == ".obj") {
        write_obj(mesh, path, files);
    } else if (extension == ".stl") {
        write_stl(mesh, path, files);
    } else if (extension == ".ply") {
        write_ply(mesh, path, files);
    } else if (extension == ".wrl") {
        write_wrl(mesh, path, files);
    } else if (extension == ".vtp") {
        write_vtp(mesh, {}, "", path, files);
    } else {
        throw InputError(path.string() + ": cannot write: the name must end in .obj, .stl, .ply, .wrl or .vtp");
    }
    std::vector<FileContents> contents;
    for (const auto& [name, bytes] : files) contents.push_back({name, bytes});
    write_whole_files(contents);
}

void save_vtp(const Mesh& mesh, std::span<const PointField> fields, const fs::path& path, const std::string& note) {
    TROCAR_ASSERT(note.find("--") == std::string::npos);
    for (const PointField& field : fields) TROCAR_ASSERT(field.values.size() == mesh.position.size() * field.components);
    Files files;
    write_vtp(mesh, fields, note, path, files);
    write_whole_file(path, files.front().second);
}

}  // namespace trocar
