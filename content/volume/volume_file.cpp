#include "content/volume/volume_file.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <map>

#include "content/text/local_file.hpp"
#include "content/text/number_text.hpp"
#include "content/text/words.hpp"
#include "content/volume/nifti_file.hpp"
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

// A line like "Segment3_Name:=Liver" in the header of a segmentation of 3D Slicer.
void note_segment(const std::string& line, std::map<uint32_t, Segment>& segments) {
    const size_t equals = line.find(":="), bar = line.find('_');
    if (!line.starts_with("Segment") || equals == std::string::npos || bar > equals || bar < 8 || bar > 16) return;
    double row = -1, number = 0;  // "Segment3" is row 3
    const std::string key = line.substr(bar + 1, equals - bar - 1), value = line.substr(equals + 2);
    if (parse_number(line.data() + 7, line.data() + bar, row) != line.data() + bar || !(row >= 0 && row < 1e6)) return;
    const bool is_number = parse_number(value.data(), value.data() + value.size(), number) == value.data() + value.size();
    const auto [found, fresh] = segments.try_emplace(static_cast<uint32_t>(row));
    Segment& segment = found->second;
    if (fresh) segment.layer = kNone;
    if (key == "Name") segment.name = value;
    if (key == "ID") segment.id = value;
    if (key == "LabelValue" && is_number) segment.label = number;
    if (key == "Layer" && is_number && number >= 0 && number < 1e6) segment.layer = static_cast<uint32_t>(number);
}

// Reads what a text header says besides the image: its segments. It may name only data files below its own folder, like every
// file that is read.
std::map<uint32_t, Segment> read_text_header(const fs::path& path) {
    constexpr size_t kHeaderLimit = size_t{1} << 24;
    std::map<uint32_t, Segment> segments;
    std::ifstream in(path, std::ios::binary);
    std::string text(kHeaderLimit, '\0');
    in.read(text.data(), static_cast<std::streamsize>(text.size()));
    text.resize(static_cast<size_t>(std::max<std::streamsize>(in.gcount(), 0)));
    const bool nrrd = text.starts_with("NRRD");
    const std::string ending = lower_case(path.extension().string());
    if (!nrrd && ending != ".mhd" && ending != ".mha") return segments;
    const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
    const auto check = [&](const std::string& name) {
        const bool pattern = name.find('%') != std::string::npos;  // one file per slice, numbered
        const std::string refusal = !pattern                                         ? find_local_file({folder}, folder, name).refusal
                                    : name.find_first_of("/\\") != std::string::npos ? "numbered slices must lie beside their header"
                                                                                     : "";
        if (!refusal.empty()) throw InputError(path.string() + ": data file \"" + name + "\": " + refusal);
    };
    bool listed = false;
    for (size_t begin = 0, end; begin < text.size(); begin = end + 1) {
        end = std::min(text.find('\n', begin), text.size());
        const std::string line = without_blanks(text.substr(begin, end - begin));
        const std::string name = listed ? line : named_data_file(line), word = lower_case(name);
        if ((nrrd && !listed && line.empty()) || word == "local") return segments;  // voxel data begins
        if (nrrd) note_segment(line, segments);
        if (name.empty()) continue;
        if (!listed && word.starts_with("list")) {
            listed = true;
        } else {
            check(name);
        }
    }
    if (text.size() == kHeaderLimit) throw InputError(path.string() + ": a header longer than 16 MiB");
    return segments;
}

// The segments of a volume; a header without layers numbers them like the segments.
std::vector<Segment> place_segments(const std::map<uint32_t, Segment>& named, uint32_t layers) {
    std::vector<Segment> segments;
    for (const auto& [row, segment] : named) {
        segments.push_back(segment);
        if (segment.layer == kNone) segments.back().layer = layers > 1 ? row : 0;
        if (segments.back().layer >= layers)
            throw InputError("segment \"" + segment.name + "\" is in layer " + std::to_string(segments.back().layer) + " of " +
                             std::to_string(layers));
    }
    return segments;
}

}  // namespace

Volume decode_volume_stream(std::string bytes) {
    VolumeStreamHeader header;
    if (bytes.size() < sizeof header) refuse("it ends within the header");
    const VolumeStreamHeader expected;
    std::memcpy(&header, bytes.data(), sizeof header);
    if (std::memcmp(header.magic, expected.magic, sizeof header.magic) != 0) refuse("unknown beginning");
    if (header.version != expected.version) refuse("version " + std::to_string(header.version));
    if (header.type > static_cast<uint32_t>(VoxelType::kUint64)) refuse("type " + std::to_string(header.type));
    Volume volume;
    volume.type = static_cast<VoxelType>(header.type);
    uint64_t count = scalar_bytes(volume.type);
    for (int k = 0; k < 3; ++k) {
        if (header.size[k] == 0 || header.size[k] > kSideLimit) refuse("a side has " + std::to_string(header.size[k]) + " voxels");
        count *= header.size[k];
        if (count > kVoxelBytesLimit) refuse("more voxels than 4 GiB hold");
        volume.size[k] = static_cast<uint32_t>(header.size[k]);
    }
    if (header.layers == 0 || header.layers > kVoxelBytesLimit / count) refuse(std::to_string(header.layers) + " values a voxel");
    volume.layers = static_cast<uint32_t>(header.layers);
    count *= header.layers;
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

Volume read_volume(const fs::path& path, const VolumeOptions& options) {
    std::error_code fault;
    const fs::file_status status = fs::status(path, fault);
    if (!fs::exists(status)) throw InputError(path.string() + ": no such file or folder");
    if (is_nifti_name(path)) return read_nifti(path, options.frame);
    if (!options.frame.empty()) throw InputError(path.string() + ": only NIfTI has more than one frame");
    const std::map<uint32_t, Segment> segments = fs::is_regular_file(status) ? read_text_header(path) : std::map<uint32_t, Segment>{};
    const fs::path program = find_helper_program(kVolumeReader);
    if (program.empty()) {
        throw InputError(path.string() + ": " + kVolumeReader +
                         ", which reads volumes other than NIfTI, is not there: this program was built " +
                         "without ITK (package libinsighttoolkit5-dev)");
    }
    const ChildLimits limits{.cpu_seconds = 120,
                             .wall_seconds = 600,
                             .address_space_bytes = helper_address_space(3 * kVoxelBytesLimit),
                             .output_bytes = kVoxelBytesLimit + sizeof(VolumeStreamHeader)};
    ChildResult result = run_child({program.string(), path.string(), options.series}, limits);
    if (result.end == ChildEnd::kExited && result.exit_code == 1) {
        throw InputError(path.string() + ": " + last_error_line(result));
    }
    const std::string trouble = describe_child_end(result, limits);
    if (!trouble.empty()) throw InputError(path.string() + ": its reader " + trouble);
    try {
        Volume volume = decode_volume_stream(std::move(result.output));
        if (volume.layers > 1 && segments.empty()) {
            throw InputError("has " + std::to_string(volume.layers) + " values a voxel; one is needed, or segments that name their layer");
        }
        volume.segments = place_segments(segments, volume.layers);
        const std::string said = last_error_line(result);
        if (said.starts_with("warning: ")) volume.warnings.push_back(path.string() + ": " + said.substr(9));
        return volume;
    } catch (const InputError& error) {
        throw InputError(path.string() + ": " + error.what());
    }
}

}  // namespace trocar
