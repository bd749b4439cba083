#include <assimp/MemoryIOWrapper.h>
#include <assimp/importerdesc.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <sys/resource.h>
#include <unistd.h>

#include <Eigen/LU>
#include <assimp/IOStream.hpp>
#include <assimp/IOSystem.hpp>
#include <assimp/Importer.hpp>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <new>

#include "content/read/mesh_stream.hpp"
#include "engine/base/error.hpp"
#include "engine/files/child_process.hpp"

// trocar-assimp-reader NAME < FILE > STREAM
// Reads a surface with assimp and writes it in the format of content/read/mesh_stream.hpp. It is a separate
// program because assimp crashes and hangs on damaged files; content/read/assimp_file.hpp runs it within limits.
// NAME gives the format and the folder of referenced files. Exit codes: 0 read, 1 not read (the last line of
// standard error has the reason), 2 no reader knows the format, kChildOutOfMemory.
namespace trocar {
namespace {

namespace fs = std::filesystem;

constexpr int kNotRead = 1, kUnknownFormat = 2;
constexpr uint64_t kTriangleLimit = 50'000'000;
constexpr uint64_t kSideFileLimit = uint64_t{1} << 30;

// Serves the file itself from memory, other files from below its folder, and never writes.
struct FolderFiles : Assimp::IOSystem {
    std::string name;   // of the file itself
    std::string bytes;  // its contents
    fs::path folder;    // canonical

    fs::path find(const char* asked) const {
        std::error_code fault;
        std::string text = asked;
        for (char& c : text) c = c == '\\' ? '/' : c;
        const fs::path path = fs::canonical(text, fault);
        if (fault || !fs::is_regular_file(path, fault)) return {};
        const auto [folder_end, ignored] = std::mismatch(folder.begin(), folder.end(), path.begin(), path.end());
        return folder_end == folder.end() ? path : fs::path{};
    }
    bool Exists(const char* asked) const override { return asked == name || !find(asked).empty(); }
    char getOsSeparator() const override { return '/'; }
    Assimp::IOStream* Open(const char* asked, const char* mode) override {
        if (std::strpbrk(mode, "wa+") != nullptr) return nullptr;
        if (asked == name) return new Assimp::MemoryIOStream(reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size());
        const fs::path path = find(asked);
        std::error_code fault;
        if (path.empty() || fs::file_size(path, fault) > kSideFileLimit || fault) return nullptr;
        const size_t size = static_cast<size_t>(fs::file_size(path, fault));
        auto* copy = new uint8_t[size + 1];
        std::ifstream stream(path, std::ios::binary);
        stream.read(reinterpret_cast<char*>(copy), static_cast<std::streamsize>(size));
        return new Assimp::MemoryIOStream(copy, static_cast<size_t>(stream.gcount()), true);
    }
    void Close(Assimp::IOStream* stream) override { delete stream; }
};

std::string read_standard_input() {
    std::string bytes;
    char buffer[1 << 16];
    for (ssize_t got; (got = ::read(STDIN_FILENO, buffer, sizeof buffer)) > 0;) {
        bytes.append(buffer, static_cast<size_t>(got));
    }
    return bytes;
}

using Transform = Eigen::Matrix<double, 3, 4>;

Transform to_double(const aiMatrix4x4& m) {
    Transform t;
    t << m.a1, m.a2, m.a3, m.a4, m.b1, m.b2, m.b3, m.b4, m.c1, m.c2, m.c3, m.c4;
    return t;
}

float unit(float value, float otherwise) { return std::isfinite(value) ? std::fmin(std::fmax(value, 0.f), 1.f) : otherwise; }

Material to_material(const aiScene& scene, const aiMaterial& from, std::string& picture) {
    Material material;
    aiString text;
    if (from.Get(AI_MATKEY_NAME, text) == aiReturn_SUCCESS) material.name = text.C_Str();
    const auto read_colour = [&](std::array<float, 3>& to, const char* key, unsigned type, unsigned index) {
        aiColor3D colour;
        if (from.Get(key, type, index, colour) != aiReturn_SUCCESS) return;
        to = {unit(colour.r, to[0]), unit(colour.g, to[1]), unit(colour.b, to[2])};
    };
    read_colour(material.diffuse, AI_MATKEY_COLOR_DIFFUSE);
    read_colour(material.specular, AI_MATKEY_COLOR_SPECULAR);
    float value = 0;
    // exponent of Phong's model; VRML's shininess 1 is an exponent of 128
    if (from.Get(AI_MATKEY_SHININESS, value) == aiReturn_SUCCESS) material.shininess = unit(value / 128, 0.2f);
    if (from.Get(AI_MATKEY_OPACITY, value) == aiReturn_SUCCESS) material.transparency = 1 - unit(value, 1);
    for (const aiTextureType type : {aiTextureType_DIFFUSE, aiTextureType_BASE_COLOR}) {
        if (from.GetTexture(type, 0, &text) != aiReturn_SUCCESS) continue;
        material.texture = text.C_Str();
        const aiTexture* inside = scene.GetEmbeddedTexture(text.C_Str());
        // height 0: a compressed image of `width` bytes
        if (inside && inside->mHeight == 0) picture.assign(reinterpret_cast<const char*>(inside->pcData), inside->mWidth);
        break;
    }
    return material;
}

// State and counts of flattening a scene.
struct Flattening {
    const aiScene& scene;
    MeshStream out;
    std::vector<uint32_t> material_row;  // per material of the scene: output material, or kNone
    uint64_t lines = 0;                  // faces with one or two corners
    bool skinned = false;
};

void add_mesh(Flattening& f, const aiMesh& mesh, const Transform& transform) {
    Mesh& out = f.out.mesh;
    const size_t first = out.position.size();
    if (first + mesh.mNumVertices >= kNone) throw InputError("more vertices than 32 bits can number");
    if (out.triangle.size() + mesh.mNumFaces > kTriangleLimit) throw InputError("more than 50000000 faces");
    if (mesh.mMaterialIndex >= f.material_row.size()) throw InputError("a surface names no material of the file");
    uint32_t& row = f.material_row[mesh.mMaterialIndex];
    if (row == kNone) {
        row = static_cast<uint32_t>(out.material.size());
        if (row > 65534) throw InputError("more than 65535 materials");
        f.out.picture.emplace_back();
        out.material.push_back(to_material(f.scene, *f.scene.mMaterials[mesh.mMaterialIndex], f.out.picture.back()));
    }
    for (uint32_t v = 0; v < mesh.mNumVertices; ++v) {
        const aiVector3D& p = mesh.mVertices[v];
        out.position.push_back(transform * Eigen::Vector4d(p.x, p.y, p.z, 1));
    }
    f.skinned = f.skinned || mesh.mNumBones > 0;
    const aiVector3D* uv = mesh.mTextureCoords[0];
    if (uv && out.uv.empty()) out.uv.resize(out.triangle.size());
    const bool with_uv = uv || !out.uv.empty();
    const bool mirrored = transform.leftCols<3>().determinant() < 0;
    for (uint32_t t = 0; t < mesh.mNumFaces; ++t) {
        const aiFace& face = mesh.mFaces[t];
        f.lines += face.mNumIndices < 3;
        if (face.mNumIndices < 3) continue;
        if (face.mNumIndices > 3) throw InputError("a face was not cut into triangles");
        std::array<uint32_t, 3> corner{face.mIndices[0], face.mIndices[1], face.mIndices[2]};
        if (mirrored) std::swap(corner[1], corner[2]);
        std::array<Vec2, 3> row_uv{};
        for (size_t k = 0; k < 3; ++k) {
            if (corner[k] >= mesh.mNumVertices) throw InputError("a face names a vertex the file does not have");
            if (!uv) continue;
            const aiVector3D& at = uv[corner[k]];
            row_uv[k] = {std::isfinite(at.x) ? at.x : 0.f, std::isfinite(at.y) ? at.y : 0.f};
        }
        const auto base = static_cast<uint32_t>(first);
        out.triangle.push_back({base + corner[0], base + corner[1], base + corner[2]});
        out.triangle_material.push_back(static_cast<uint16_t>(row));
        if (with_uv) out.uv.push_back(row_uv);
    }
}

void flatten(Flattening& f) {
    struct Visit {
        const aiNode* node;
        Transform transform;
    };
    std::vector<Visit> open{{f.scene.mRootNode, Transform::Identity()}};
    while (!open.empty()) {
        const Visit visit = open.back();
        open.pop_back();
        if (!visit.node) continue;
        const Transform local = to_double(visit.node->mTransformation);
        Transform world = visit.transform.leftCols<3>() * local;
        world.col(3) += visit.transform.col(3);
        for (uint32_t m = 0; m < visit.node->mNumMeshes; ++m) {
            const uint32_t row = visit.node->mMeshes[m];
            if (row >= f.scene.mNumMeshes || !f.scene.mMeshes[row]) throw InputError("a node names a surface the file does not have");
            add_mesh(f, *f.scene.mMeshes[row], world);
        }
        for (uint32_t c = visit.node->mNumChildren; c-- > 0;) open.push_back({visit.node->mChildren[c], world});
    }
}

void add_warnings(Flattening& f) {
    std::vector<std::string>& warnings = f.out.warnings;
    double largest = 0;
    for (const Vec3d& p : f.out.mesh.position) largest = std::fmax(largest, p.cwiseAbs().maxCoeff());
    char text[160];
    // half a unit in the last place of a 24-bit significand
    std::snprintf(text, sizeof text, "coordinates went through 32-bit floats: rounded by about %.2g", largest * 0x1p-24);
    warnings.push_back(text);
    if (f.lines > 0) warnings.push_back(std::to_string(f.lines) + " lines or points passed over");
    if (f.skinned) warnings.push_back("the skeleton is passed over: the surface is taken as it is stored");
    double factor = 0;
    float single = 0;
    const aiMetadata* data = f.scene.mMetaData;
    if (data && data->Get("UnitScaleFactor", single)) factor = single;
    if (data && factor == 0) data->Get("UnitScaleFactor", factor);
    if (factor > 0) {
        std::snprintf(text, sizeof text, "the file says that one unit is %g cm; coordinates are left as they are", factor);
        warnings.push_back(text);
    }
}

void check_corners(const aiScene& scene) {
    for (uint32_t m = 0; m < scene.mNumMeshes; ++m) {
        const aiMesh& mesh = *scene.mMeshes[m];
        for (uint32_t t = 0; t < mesh.mNumFaces; ++t) {
            const aiFace& face = mesh.mFaces[t];
            for (uint32_t k = 0; k < face.mNumIndices; ++k) {
                if (face.mIndices[k] < mesh.mNumVertices) continue;
                throw InputError("surface " + std::to_string(m) + ", face " + std::to_string(t) + " names vertex " +
                                 std::to_string(face.mIndices[k]) + " of " + std::to_string(mesh.mNumVertices));
            }
        }
    }
}

// Excludes the formats that this project reads itself; assimp 5.2 takes many of them for Blender files.
void drop_wrong_readers(Assimp::Importer& importer, const std::string& bytes) {
    for (const char* extension : {"x3d", "obj", "stl", "ply", "off", "blend"}) {
        if (extension == std::string_view("blend") && bytes.starts_with("BLENDER")) continue;
        if (Assimp::BaseImporter* reader = importer.GetImporter(extension)) importer.UnregisterLoader(reader);
    }
}

int read(const char* name) {
    auto* files = new FolderFiles;  // owned by the importer from here on
    Assimp::Importer importer;
    importer.SetIOHandler(files);
    files->name = name;
    files->bytes = read_standard_input();
    const fs::path parent = fs::path(name).parent_path();
    files->folder = fs::canonical(parent.empty() ? fs::path(".") : parent);
    drop_wrong_readers(importer, files->bytes);
    const aiScene* scene = importer.ReadFile(name, 0);
    if (scene) {
        check_corners(*scene);  // cut_polygons relies on valid corners
        scene = importer.ApplyPostProcessing(aiProcess_Triangulate);
    }
    if (!scene) {
        const std::string reason = importer.GetErrorString();
        std::fprintf(stderr, "%s\n", reason.c_str());
        return reason.starts_with("No suitable reader found") ? kUnknownFormat : kNotRead;
    }
    Flattening f{*scene, {}, std::vector<uint32_t>(scene->mNumMaterials, kNone)};
    const int index = importer.GetPropertyInteger("importerIndex", -1);
    const aiImporterDesc* description = index >= 0 ? importer.GetImporterInfo(static_cast<size_t>(index)) : nullptr;
    f.out.format = description ? description->mName : "unknown";
    if (!scene->mRootNode || scene->mNumMeshes == 0) throw InputError(f.out.format + " found no surface");
    flatten(f);
    if (f.out.mesh.triangle.empty()) throw InputError(f.out.format + " found no face");
    add_warnings(f);
    const std::string stream = encode_mesh_stream(f.out);
    const bool written = std::fwrite(stream.data(), 1, stream.size(), stdout) == stream.size() && std::fflush(stdout) == 0;
    return written ? 0 : kNotRead;
}

}  // namespace
}  // namespace trocar

int main(int argc, char** argv) {
    if (argc != 2) {
        std::fprintf(stderr, "usage: trocar-assimp-reader NAME < FILE > STREAM (a helper of trocar)\n");
        return trocar::kNotRead;
    }
    const rlimit none{0, 0};
    ::setrlimit(RLIMIT_FSIZE, &none);  // the library must not write any file, whatever the input
    // exit without destructors, which may crash on a damaged scene
    try {
        std::_Exit(trocar::read(argv[1]));
    } catch (const std::bad_alloc&) {
        std::_Exit(trocar::kChildOutOfMemory);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s\n", error.what());
        std::_Exit(trocar::kNotRead);
    }
}
