#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

inline constexpr uint64_t kImagePixelLimit = uint64_t{1} << 26;  // 8192 x 8192

// Picture of a PNG, JPEG or GIF (first frame) file, identified by its content. `name` begins the message of
// the InputError thrown if it is none of these, damaged, truncated or larger than kImagePixelLimit.
Image decode_image(std::string_view bytes, const std::string& name);
Image load_image(const std::filesystem::path& path);

// A picture of half the size, at least 1 x 1: means of 2 x 2 encoded values; an odd last row or column is dropped.
Image halved(const Image& image);

// The picture as PNG, RGB if every pixel is opaque. Same bytes for the same picture.
std::vector<std::byte> encode_png(const Image& image);
// Written completely or not at all; throws InputError "file: reason".
void save_png(const Image& image, const std::filesystem::path& path);

}  // namespace trocar
