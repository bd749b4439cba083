#include "content/volume/nifti_file.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "content/text/byte_order.hpp"
#include "content/text/words.hpp"
#include "content/volume/volume_stream.hpp"
#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
namespace trocar {
namespace {

using Affine = Eigen::Matrix<double, 3, 4>;  // mm, RAS, of a voxel index

struct NiftiState {
    std::string name;
    std::string bytes;
    bool second = false, big = false;
    Volume volume{};

    [[noreturn]] void fail(const std::string& reason) const { throw InputError(name + ": " + reason); }
    void warn(const std::string& text) { volume.warnings.push_back(name + ": " + text); }
    // The field at one place in NIfTI-1 and another in NIfTI-2.
    template <typename First, typename Second>
    double value(size_t first, size_t in_second, size_t row = 0) const {
        return second ? static_cast<double>(number_from_bytes<Second>(bytes.data() + in_second + row * sizeof(Second), big))
                      : static_cast<double>(number_from_bytes<First>(bytes.data() + first + row * sizeof(First), big));
    }
    double real(size_t first, size_t in_second, size_t row = 0) const { return value<float, double>(first, in_second, row); }
};

void find_version(NiftiState& s) {
    const auto begins_with = [&](int32_t size, bool big) { return number_from_bytes<int32_t>(s.bytes.data(), big) == size; };
    if (s.bytes.size() < 348) s.fail("ends within its header");
    s.big = begins_with(348, true) || begins_with(540, true);
    s.second = begins_with(540, s.big);
    if (!s.second && !begins_with(348, s.big)) s.fail("is not NIfTI");
    if (s.second && s.bytes.size() < 540) s.fail("ends within its header");
    if (s.bytes.compare(s.second ? 4 : 344, 2, "ni") == 0) s.fail("keeps its voxels in another file (.img), which is not read");
}

VoxelType nifti_type(const NiftiState& s) {
    const double code = s.value<int16_t, int16_t>(70, 12);
    constexpr std::pair<int, VoxelType> kTypes[] = {
        {2, VoxelType::kUint8}, {256, VoxelType::kInt8},    {512, VoxelType::kUint16}, {4, VoxelType::kInt16},  {768, VoxelType::kUint32},
        {8, VoxelType::kInt32}, {1280, VoxelType::kUint64}, {1024, VoxelType::kInt64}, {16, VoxelType::kFloat}, {64, VoxelType::kDouble}};
    for (const auto& [known, type] : kTypes) {
        if (code == known) return type;
    }
    s.fail("a voxel type this program does not take (" + std::to_string(static_cast<int>(code)) + ")");
}

// Sizes; returns the number of bytes of the voxels.
uint64_t read_sizes(NiftiState& s) {
    const double dimensions = s.value<int16_t, int64_t>(40, 16);
    if (!(dimensions >= 1 && dimensions <= 7)) s.fail("names " + std::to_string(static_cast<int64_t>(dimensions)) + " dimensions");
    if (dimensions < 2) s.fail("has one dimension; three are needed");
    uint64_t wanted = scalar_bytes(s.volume.type);
    for (size_t k = 0; k < static_cast<size_t>(dimensions); ++k) {
        const double size = s.value<int16_t, int64_t>(40, 16, k + 1);
        if (k > 2 && size > 1) s.fail("has " + std::to_string(static_cast<int>(dimensions)) + " dimensions; three are needed");
        if (k > 2) continue;
        if (!(size >= 1)) s.fail("has a side without voxels");
        if (size > static_cast<double>(kVoxelBytesLimit / wanted)) s.fail("claims more voxels than 4 GiB hold");
        s.volume.size[k] = static_cast<uint32_t>(size);
        wanted *= s.volume.size[k];
    }
    if (dimensions < 3) s.volume.size[2] = 1;
    return wanted;
}

// Millimetres per unit of length.
double read_unit(NiftiState& s) {
    const int unit = static_cast<int>(s.value<uint8_t, int32_t>(123, 500)) & 7;
    if (unit > 3) s.warn("unit of length " + std::to_string(unit) + " is not known; millimetres are assumed");
    return unit == 1 ? 1000 : unit == 3 ? 1e-3 : 1;
}

Vec3d read_spacing(NiftiState& s, bool said) {
    Vec3d spacing;
    for (int k = 0; k < 3; ++k) {
        spacing[k] = std::abs(s.real(76, 104, static_cast<size_t>(k) + 1));
        if (spacing[k] > 0 && std::isfinite(spacing[k])) continue;
        spacing[k] = 1;
        if (said && s.volume.size[static_cast<size_t>(k)] > 1)
            s.warn("the voxel size along axis " + std::to_string(k + 1) + " is 0 or no number; 1 is assumed");
    }
    return spacing;
}

// Method 2: a rotation by a unit quaternion of which the header holds b, c and d.
Affine qform_of(const NiftiState& s, const Vec3d& spacing) {
    Eigen::Quaterniond q(0, s.real(256, 352), s.real(256, 352, 1), s.real(256, 352, 2));
    q.w() = std::sqrt(std::max(0.0, 1 - q.squaredNorm()));
    const double handed = s.real(76, 104) < 0 ? -1 : 1;
    Affine a;
    a.leftCols<3>() = q.normalized().toRotationMatrix() * Vec3d(spacing.x(), spacing.y(), handed * spacing.z()).asDiagonal();
    a.col(3) = Vec3d(s.real(268, 376), s.real(268, 376, 1), s.real(268, 376, 2));
    return a;
}

Affine sform_of(const NiftiState& s) {
    Affine a;
    for (int row = 0; row < 3; ++row) {
        for (int c = 0; c < 4; ++c) a(row, c) = s.real(280, 400, static_cast<size_t>(4 * row + c));
    }
    return a;
}

// The farthest that a corner of the volume lies from itself in another frame, in voxels of the smallest side.
double frames_apart(const Volume& volume, const Affine& a, const Affine& b) {
    const Affine d = a - b;
    double most = 0;
    for (int corner = 0; corner < 8; ++corner) {
        Vec3d p = d.col(3);
        for (int k = 0; k < 3; ++k) p += (corner >> k & 1) * (volume.size[static_cast<size_t>(k)] - 1.0) * d.col(k);
        most = std::max(most, p.norm());
    }
    return most / a.leftCols<3>().colwise().norm().minCoeff();
}

Affine choose_frame(NiftiState& s, const std::string& frame) {
    const bool has_qform = s.value<int16_t, int32_t>(252, 344) > 0, has_sform = s.value<int16_t, int32_t>(254, 348) > 0;
    if ((frame == "sform" && !has_sform) || (frame == "qform" && !has_qform)) s.fail("has no " + frame);
    const bool by_sform = frame == "sform" || (frame.empty() && has_sform);
    const Vec3d spacing = read_spacing(s, !by_sform);
    const Affine sform = sform_of(s);
    Affine qform = qform_of(s, spacing);
    if (!by_sform && !has_qform) {
        qform = Affine::Zero();
        qform.diagonal() = spacing;
        s.warn("has neither sform nor qform: which way it lies in the patient is not known");
    }
    const Affine& chosen = by_sform ? sform : qform;
    if (!chosen.allFinite()) s.fail("its place in space is not finite");
    const double volume = chosen.leftCols<3>().determinant();
    if (!(std::abs(volume) > 1e-3 * chosen.leftCols<3>().colwise().norm().prod())) s.fail("its axes lie in a plane");
    // quaternions in single precision turn a long row of voxels by some hundredths of a voxel
    const double apart = has_sform && has_qform ? frames_apart(s.volume, chosen, by_sform ? qform : sform) : 0;
    if (!(apart <= 0.1)) {
        const bool mirrored = sform.leftCols<3>().determinant() * qform.leftCols<3>().determinant() < 0;
        char text[64];
        std::snprintf(text, sizeof text, "sform and qform differ by %.3g voxels", apart);
        s.warn(std::string(text) + (mirrored ? " and mirror each other" : "") + "; taken: the " + (by_sform ? "sform" : "qform") +
               " (--frame " + (by_sform ? "qform" : "sform") + " takes the other)");
    }
    return chosen;
}

template <typename Stored>
void scale_voxels(const std::string& stored, double slope, double shift, std::string& voxels) {
    const size_t count = stored.size() / sizeof(Stored);
    voxels.resize(count * sizeof(double));
    for (size_t i = 0; i < count; ++i) {
        const double value = slope * static_cast<double>(number_from_bytes<Stored>(stored.data() + i * sizeof(Stored), false)) + shift;
        std::memcpy(voxels.data() + i * sizeof value, &value, sizeof value);
    }
}

// Applies slope and intercept, which count if the slope is not 0.
void apply_scale(NiftiState& s) {
    const double slope = s.real(112, 176), shift = s.real(116, 184);
    if (!std::isfinite(slope) || !std::isfinite(shift) || slope == 0 || (slope == 1 && shift == 0)) return;
    const std::string stored = std::move(s.volume.voxels);
    if (stored.size() / scalar_bytes(s.volume.type) > kVoxelBytesLimit / sizeof(double))
        s.fail("scaled to doubles, it has more than 4 GiB");
    with_scalar(s.volume.type, [&](auto zero) { scale_voxels<decltype(zero)>(stored, slope, shift, s.volume.voxels); });
    s.volume.type = VoxelType::kDouble;
}

}  // namespace

bool is_nifti_name(const std::filesystem::path& path) {
    const std::string name = lower_case(path.filename().string());
    return name.ends_with(".nii") || name.ends_with(".nii.gz");
}

Volume read_nifti(const std::filesystem::path& path, const std::string& frame) {
    NiftiState s{path.string(), read_text_file(path, kVoxelBytesLimit + (1 << 20))};
    find_version(s);
    Volume& volume = s.volume;
    volume.type = nifti_type(s);
    const uint64_t wanted = read_sizes(s);
    const double offset = s.value<float, int64_t>(108, 168);
    if (!(offset >= (s.second ? 540 : 348) && offset <= 1e9)) s.fail("its voxels begin at byte " + std::to_string(offset));
    const uint64_t begin = static_cast<uint64_t>(offset), there = s.bytes.size();
    const std::string sizes = "its header asks for " + std::to_string(begin + wanted) + " bytes, " + std::to_string(there) + " are there";
    if (there < begin + wanted) s.fail("is cut short: " + sizes);
    if (there > begin + wanted) s.warn("is longer than it says, and the end is passed over: " + sizes);
    const double unit = read_unit(s);
    Affine place = unit * choose_frame(s, frame);
    place.topRows<2>() *= -1;  // to LPS
    volume.origin = place.col(3);
    for (int k = 0; k < 3; ++k) volume.step[static_cast<size_t>(k)] = place.col(k);
    volume.voxels = std::move(s.bytes);
    s.bytes.assign(volume.voxels, 0, 540);  // what follows still reads the header
    volume.voxels.resize(begin + wanted);
    volume.voxels.erase(0, begin);
    const size_t bytes = scalar_bytes(volume.type);
    for (size_t at = 0; s.big && at < volume.voxels.size(); at += bytes) {
        std::reverse(volume.voxels.begin() + static_cast<std::ptrdiff_t>(at),
                     volume.voxels.begin() + static_cast<std::ptrdiff_t>(at + bytes));
    }
    apply_scale(s);
    return std::move(volume);
}

}  // namespace trocar
