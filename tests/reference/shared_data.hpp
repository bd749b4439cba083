#pragma once
#include <cstring>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>

#include "components/mesh.hpp"
#include "reference/paths.hpp"
namespace trocar::reference {

// Path in the folder of real meshes, which tests use if it exists.
inline std::string shared_data(const std::string& file) { return (shared_data_folder() / file).string(); }

// Minimal readers of well-formed binary STL, OBJ and ASCII VTK polydata, independent of content/. Empty if
// the file is absent.
inline Mesh read_plain_mesh(const std::string& path) {
    Mesh m;
    std::ifstream in(path, std::ios::binary);
    if (!in) return m;
    const std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
    if (path.ends_with(".stl")) {
        for (size_t at = 84; at + 50 <= bytes.size(); at += 50) {
            const uint32_t first = static_cast<uint32_t>(m.position.size());
            for (int k = 0; k < 3; ++k) {
                float p[3];
                std::memcpy(p, bytes.data() + at + 12 + 12 * k, sizeof p);
                m.position.push_back(Vec3d(p[0], p[1], p[2]));
            }
            m.triangle.push_back({first, first + 1, first + 2});
        }
        return m;
    }
    std::istringstream text(bytes);
    if (path.ends_with(".obj")) {
        for (std::string line; std::getline(text, line);) {
            std::istringstream words(line);
            std::string word;
            words >> word;
            if (word == "v") {
                Vec3d p;
                words >> p.x() >> p.y() >> p.z();
                m.position.push_back(p);
            } else if (word == "f") {
                std::vector<uint32_t> corner;
                while (words >> word) corner.push_back(static_cast<uint32_t>(std::stoul(word)) - 1);
                for (size_t k = 2; k < corner.size(); ++k) m.triangle.push_back({corner[0], corner[k - 1], corner[k]});
            }
        }
        return m;
    }
    for (std::string word; text >> word;) {
        size_t count = 0;
        if (word == "POINTS" && text >> count >> word) {
            m.position.resize(count);
            for (Vec3d& p : m.position) text >> p.x() >> p.y() >> p.z();
        } else if (word == "POLYGONS" && text >> count >> word) {
            m.triangle.resize(count);
            for (Triangle& t : m.triangle) text >> word >> t[0] >> t[1] >> t[2];
        }
    }
    return m;
}

}  // namespace trocar::reference
