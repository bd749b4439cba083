#include "content/volume/volume_file.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <fstream>

#include "content/text/local_file.hpp"
#include "content/text/words.hpp"
#include "engine/base/error.hpp"
#include "engine/files/child_process.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

constexpr const char* kVolumeReader = "trocar-volume-reader";
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

std::string without_blanks(const std::string& text) {
    const size_t begin = text.find_first_not_of(" \t\r"), end = text.find_last_not_of(" \t\r");
    return begin == std::string::npos ? "" : text.substr(begin, end - begin + 1);
}

// The data file named in a header line of NRRD ("data file: x") or MetaImage ("ElementDataFile = x"), or
// empty.
std::string named_data_file(const std::string& line) {
    const size_t colon = line.find_first_of(":=");
    if (colon == std::string::npos) return "";
    const std::string key = lower_case(without_blanks(line.substr(0, colon)));
    if (key != "data file" && key != "datafile" && key != "elementdatafile") return "";
    return without_blanks(line.substr(colon + 1));
}

// A text header may name only data files below its own folder, like every file that is read.
void refuse_outside_files(const fs::path& path) {
    std::ifstream in(path, std::ios::binary);
    std::string text(64 * 1024, '\0');
    in.read(text.data(), static_cast<std::streamsize>(text.size()));
    text.resize(static_cast<size_t>(std::max<std::streamsize>(in.gcount(), 0)));
    const bool nrrd = text.starts_with("NRRD");
    const std::string ending = lower_case(path.extension().string());
    if (!nrrd && ending != ".mhd" && ending != ".mha") return;
    const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
    const auto check = [&](const std::string& name) {
        const bool pattern = name.find('%') != std::string::npos;  // one file per slice, numbered
        const std::string refusal = !pattern                                         ? find_local_file(folder, folder, name).refusal
                                    : name.find_first_of("/\\") != std::string::npos ? "numbered slices must lie beside their header"
                                                                                     : "";
        if (!refusal.empty()) throw InputError(path.string() + ": data file \"" + name + "\": " + refusal);
    };
    bool listed = false;
    for (size_t begin = 0, end; begin < text.size(); begin = end + 1) {
        end = std::min(text.find('\n', begin), text.size());
        const std::string line = without_blanks(text.substr(begin, end - begin));
        const std::string name = listed ? line : named_data_file(line), word = lower_case(name);
        if ((nrrd && !listed && line.empty()) || word == "local") return;  // voxel data begins
        if (name.empty()) continue;
        if (!listed && word.starts_with("list")) {
            listed = true;
        } else {
            check(name);
        }
    }
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
    if (fs::is_regular_file(status)) refuse_outside_files(path);
    const fs::path program = find_helper_program(kVolumeReader);
    if (program.empty()) {
        throw InputError(path.string() + ": " + kVolumeReader + ", which reads volumes, is not there: this program was built " +
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
