#include "engine/files/zlib_bytes.hpp"

#include <libdeflate.h>

#include <memory>

#include "engine/base/check.hpp"
namespace trocar {

std::vector<uint8_t> zlib_compress(std::span<const uint8_t> bytes, int level) {
    const std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)> compressor(libdeflate_alloc_compressor(level),
                                                                                                   libdeflate_free_compressor);
    TROCAR_ASSERT(compressor);
    std::vector<uint8_t> packed(libdeflate_zlib_compress_bound(compressor.get(), bytes.size()));
    packed.resize(libdeflate_zlib_compress(compressor.get(), bytes.data(), bytes.size(), packed.data(), packed.size()));
    TROCAR_ASSERT(!packed.empty());
    return packed;
}

}  // namespace trocar
