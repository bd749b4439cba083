#include "content/volume_file.hpp"

#include <cmath>
#include <cstring>

#include "engine/child_process.hpp"
#include "engine/error.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

constexpr const char* kProgram = "trocar-volume-reader";
constexpr uint32_t kSideLimit = 1u << 20;  // voxels

[[noreturn]] void refuse(const std::string& reason) { throw InputError("its reader's answer is not sound: " + reason); }

void check_frame(const VolumeStreamHeader& header) {
    for (int k = 0; k < 3; ++k) {
        if (!std::isfinite(header.origin[k])) refuse("the origin is not finite");
        if (!(header.spacing[k] > 0) || !std::isfinite(header.spacing[k])) refuse("a spacing is not positive");
        double square = 0;
        for (int c = 0; c < 3; ++c) square += header.direction[3 * k + c] * header.direction[3 * k + c];
        if (!(std::abs(square - 1) < 1e-3)) refuse("a direction is not of length one");
    }
}

std::string last_line(const std::string& text) {
    const size_t end = text.find_last_not_of("\r\n ");
    if (end == std::string::npos) return "no reason given";
    const size_t begin = text.find_last_of('\n', end);
    return text.substr(begin == std::string::npos ? 0 : begin + 1, end - (begin == std::string::npos ? 0 : begin + 1) + 1);
}

}  // namespace

Volume decode_volume_stream(std::string bytes) {
    VolumeStreamHeader header;
    if (bytes.size() < sizeof header) refuse("it ends within the header");
    const VolumeStreamHeader expected;
    std::memcpy(&header, bytes.data(), sizeof header);
    if (std::memcmp(header.magic, expected.magic, sizeof header.magic) != 0) refuse("unknown beginning");
    if (header.version != expected.version) refuse("version " + std::to_string(header.version));
    if (header.type > static_cast<uint32_t>(VoxelType::kDouble)) refuse("type " + std::to_string(header.type));
    Volume volume;
    volume.type = static_cast<VoxelType>(header.type);
    uint64_t count = voxel_bytes(volume.type);
    for (int k = 0; k < 3; ++k) {
        if (header.size[k] == 0 || header.size[k] > kSideLimit) refuse("a side has " + std::to_string(header.size[k]) + " voxels");
        count *= header.size[k];
        if (count > kVoxelBytesLimit) refuse("more voxels than 4 GiB hold");
        volume.size[k] = static_cast<uint32_t>(header.size[k]);
    }
    if (header.voxel_bytes != count || bytes.size() - sizeof header != count) refuse("sizes and bytes do not agree");
    check_frame(header);
    for (int k = 0; k < 3; ++k) {
        volume.origin[k] = header.origin[k];
        for (int c = 0; c < 3; ++c) volume.step[k][c] = header.direction[3 * k + c] * header.spacing[k];
    }
    const double cell = header.spacing[0] * header.spacing[1] * header.spacing[2];
    if (!(voxel_volume(volume) > 1e-3 * cell) || !std::isfinite(cell)) refuse("the directions lie in a plane");
    volume.voxels = std::move(bytes);
    volume.voxels.erase(0, sizeof header);
    return volume;
}

Volume read_volume(const fs::path& path, const std::string& series) {
    std::error_code fault;
    const fs::file_status status = fs::status(path, fault);
    if (!fs::exists(status)) throw InputError(path.string() + ": no such file or folder");
    const fs::path program = find_helper_program(kProgram);
    if (program.empty()) {
        throw InputError(path.string() + ": " + kProgram + ", which reads volumes, is not there: this program was built " +
                         "without ITK (package libinsighttoolkit5-dev)");
    }
    const ChildLimits limits{.cpu_seconds = 120,
                             .wall_seconds = 600,
                             .address_space_bytes = helper_address_space(3 * kVoxelBytesLimit),
                             .output_bytes = kVoxelBytesLimit + sizeof(VolumeStreamHeader)};
    ChildResult result = run_child({program.string(), path.string(), series}, limits);
    if (result.end == ChildEnd::kExited && result.exit_code == 1) {
        throw InputError(path.string() + ": " + last_line(result.last_errors));
    }
    const std::string trouble = describe_child_end(result, limits);
    if (!trouble.empty()) throw InputError(path.string() + ": its reader " + trouble);
    try {
        return decode_volume_stream(std::move(result.output));
    } catch (const InputError& error) {
        throw InputError(path.string() + ": " + error.what());
    }
}

}  // namespace trocar
