#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// What a reader in a child process hands back. Images of materials stay undecoded: the parent decodes them.
struct MeshStream {
    Mesh mesh;
    std::vector<std::string> picture;  // per material: PNG, JPEG or GIF bytes that were inside the file, or empty
    std::vector<std::string> warnings;
    std::string format;
};

// The plain binary form: "trocar mesh 1\n", the counts as 64-bit numbers (vertices, triangles, texture coordinate rows,
// rows of triangle_material, materials, warnings), then positions (3 doubles), triangles (3 x 32 bits), texture
// coordinates (6 floats), material rows (16 bits), materials (name, texture, picture, 8 floats), format, warnings.
// Little endian, nothing between; a text is its length in 64 bits and its bytes.
std::string encode_mesh_stream(const MeshStream& stream);

// Trusts nothing: counts against the bytes there, corners and materials against counts, every number finite, the end
// where it should be. Throws InputError with the reason, without a file name.
MeshStream decode_mesh_stream(std::string_view bytes);

}  // namespace trocar
