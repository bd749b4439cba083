#include "content/volume/nifti_file.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstring>
#include <random>

#include "content/volume/volume_file.hpp"
#include "reference/gzip.hpp"
#include "tests/content/mend/mesh_sums.hpp"
#include "tests/reference/shared_data.hpp"
namespace trocar {
namespace {

constexpr std::array<uint32_t, 3> kSides{5, 4, 3};

// Where voxels lie, in millimetres and RAS.
struct Frame {
    Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  // columns: steps of the indices
    Vec3d origin = Vec3d::Zero();
};

// A header to write, in either version and byte order, after nifti1.h and nifti2.h.
struct Header {
    bool second = false, big = false;
    int unit = 2, qform_code = 0, sform_code = 0;
    Frame qform, sform;                        // the qform's axes are a rotation, perhaps mirrored, times the voxel size
    std::array<double, 3> pixdim{-1, -1, -1};  // -1 = the lengths of the qform's axes
    int type = 4, bits = 16;
    double slope = 0, shift = 0;
};

template <typename Value>
void put_at(std::string& bytes, size_t at, Value value, bool big) {
    std::array<char, sizeof(Value)> raw;
    std::memcpy(raw.data(), &value, sizeof value);
    if (big) std::reverse(raw.begin(), raw.end());
    bytes.replace(at, sizeof value, raw.data(), sizeof value);
}

std::string header_bytes(const Header& h) {
    const double mm = h.unit == 1 ? 1e-3 : h.unit == 3 ? 1e3 : 1;  // units in a millimetre
    std::string bytes(h.second ? 544 : 352, '\0');
    const auto whole = [&](size_t first, size_t second, int row, int value) {
        if (h.second) {
            put_at(bytes, second + 8 * size_t(row), int64_t{value}, h.big);
        } else {
            put_at(bytes, first + 2 * size_t(row), static_cast<int16_t>(value), h.big);
        }
    };
    const auto code = [&](size_t first, size_t second, int value) {
        if (h.second) {
            put_at(bytes, second, int32_t{value}, h.big);
        } else {
            put_at(bytes, first, static_cast<int16_t>(value), h.big);
        }
    };
    const auto real = [&](size_t first, size_t second, int row, double value) {
        if (h.second) {
            put_at(bytes, second + 8 * size_t(row), value, h.big);
        } else {
            put_at(bytes, first + 4 * size_t(row), static_cast<float>(value), h.big);
        }
    };
    put_at(bytes, 0, int32_t{h.second ? 540 : 348}, h.big);
    bytes.replace(h.second ? 4 : 344, 3, h.second ? "n+2" : "n+1");
    whole(40, 16, 0, 3);
    for (int k = 0; k < 3; ++k) whole(40, 16, k + 1, int(kSides[size_t(k)]));
    for (int k = 4; k < 8; ++k) whole(40, 16, k, 1);
    put_at(bytes, h.second ? 12 : 70, static_cast<int16_t>(h.type), h.big);
    put_at(bytes, h.second ? 14 : 72, static_cast<int16_t>(h.bits), h.big);
    Vec3d size = h.qform.axes.colwise().norm();
    Eigen::Matrix3d turn = h.qform.axes * size.cwiseInverse().asDiagonal();
    const bool mirrored = turn.determinant() < 0;
    if (mirrored) turn.col(2) *= -1;
    real(76, 104, 0, mirrored ? -1 : 1);
    for (int k = 0; k < 3; ++k) real(76, 104, k + 1, h.pixdim[size_t(k)] < 0 ? size[k] * mm : h.pixdim[size_t(k)]);
    if (h.second) {
        put_at(bytes, 168, int64_t{544}, h.big);
        put_at(bytes, 500, int32_t{h.unit | 8}, h.big);
    } else {
        put_at(bytes, 108, 352.0f, h.big);
        bytes[123] = static_cast<char>(h.unit | 8);  // with seconds
    }
    real(112, 176, 0, h.slope);
    real(116, 184, 0, h.shift);
    code(252, 344, h.qform_code);
    code(254, 348, h.sform_code);
    Eigen::Quaterniond q(turn);
    if (q.w() < 0) q.coeffs() *= -1;
    for (int k = 0; k < 3; ++k) {
        real(256, 352, k, q.coeffs()[k]);
        real(268, 376, k, h.qform.origin[k] * mm);
    }
    for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) real(280, 400, 4 * r + c, h.sform.axes(r, c) * mm);
        real(280, 400, 4 * r + 3, h.sform.origin[r] * mm);
    }
    return bytes;
}

int value_at(size_t i) { return static_cast<int>(i) % 100; }

template <typename Value>
std::string voxels_of(bool big) {
    std::string bytes(60 * sizeof(Value), '\0');
    for (size_t i = 0; i < 60; ++i) put_at(bytes, i * sizeof(Value), static_cast<Value>(value_at(i)), big);
    return bytes;
}

Frame random_frame(std::mt19937& random, bool mirrored) {
    std::uniform_real_distribution<double> number(-1, 1);
    Frame frame;
    frame.axes = Eigen::Quaterniond(number(random), number(random), number(random), number(random)).normalized().toRotationMatrix() *
                 Vec3d(0.7 + 0.1 * number(random), 1.5, 2.5).asDiagonal();
    if (mirrored) frame.axes.col(2) *= -1;
    frame.origin = Vec3d(100 * number(random), 100 * number(random), 100 * number(random));
    return frame;
}

struct NiftiFile : FolderTest {
    Volume read(const Header& h, const std::string& frame = "") const {
        return read_nifti(put("a.nii", header_bytes(h) + voxels_of<int16_t>(h.big)), frame);
    }
    std::string error_of(const std::string& bytes, const std::string& frame = "") const {
        try {
            read_nifti(put("a.nii", bytes), frame);
        } catch (const InputError& error) {
            return error.what();
        }
        return "no error";
    }
};

void expect_frame(const Volume& volume, const Frame& ras, const std::string& what) {
    const Vec3d flip(-1, -1, 1);
    for (int k = 0; k < 3; ++k) {
        EXPECT_LT((volume.step[size_t(k)] - ras.axes.col(k).cwiseProduct(flip)).norm(), 3e-6) << what << " axis " << k;
    }
    EXPECT_LT((volume.origin - ras.origin.cwiseProduct(flip)).norm(), 3e-5) << what;
    ASSERT_EQ(volume.size, kSides) << what;
    for (size_t i = 0; i < 60; ++i) {
        int16_t value;
        std::memcpy(&value, volume.voxels.data() + 2 * i, 2);
        ASSERT_EQ(value, value_at(i)) << what;
    }
}

bool warned(const Volume& volume, const std::string& part) {
    return std::any_of(volume.warnings.begin(), volume.warnings.end(),
                       [&](const std::string& w) { return w.find(part) != std::string::npos; });
}

TEST_F(NiftiFile, both_versions_in_either_byte_order_and_any_unit) {
    std::mt19937 random(11);
    for (int k = 0; k < 96; ++k) {
        Header h;
        h.second = k & 1;
        h.big = k & 2;
        h.unit = 1 + k / 4 % 3;
        h.qform = h.sform = random_frame(random, k / 12 % 2);
        const int codes = k / 24 % 4;
        h.qform_code = codes == 1 ? 0 : 1 + k % 4;
        h.sform_code = codes == 0 ? 0 : 1 + k % 3;
        const Volume volume = read(h);
        const std::string what = "case " + std::to_string(k);
        expect_frame(volume, h.sform, what);
        EXPECT_TRUE(volume.warnings.empty()) << what << ": " << volume.warnings[0];
    }
}

// The rule: the sform if its code is above 0, else the qform, else multiples of the voxel size. It says when the two differ.
TEST_F(NiftiFile, frames_that_differ_are_told) {
    std::mt19937 random(5);
    for (int k = 0; k < 40; ++k) {
        Header h;
        h.second = k & 1;
        h.unit = k % 5 == 0 ? 1 : 2;
        h.qform = random_frame(random, false);
        h.sform = h.qform;
        h.qform_code = 1;
        h.sform_code = 1 + k % 3;
        const int kind = k / 2 % 4;
        if (kind == 0) h.sform.origin += Vec3d(0, 0.5, 0);
        if (kind == 1) h.sform.axes.col(0) *= -1;
        if (kind == 2) h.sform = random_frame(random, false);
        if (kind == 3) h.sform.origin += Vec3d(1e-3, 0, 0);  // rounding, not another frame
        const Volume volume = read(h), other = read(h, "qform");
        const std::string what = "case " + std::to_string(k);
        expect_frame(volume, h.sform, what);
        expect_frame(other, h.qform, what);
        expect_frame(read(h, "sform"), h.sform, what);
        EXPECT_EQ(warned(volume, "sform and qform differ by"), kind != 3) << what;
        EXPECT_EQ(warned(volume, "mirror each other"), kind == 1) << what;
        EXPECT_EQ(warned(volume, "taken: the sform (--frame qform takes the other)"), kind != 3) << what;
        EXPECT_EQ(warned(other, "taken: the qform (--frame sform takes the other)"), kind != 3) << what;
    }
    Header h;
    h.qform_code = 1;
    EXPECT_NE(error_of(header_bytes(h) + voxels_of<int16_t>(false), "sform").find("has no sform"), std::string::npos);
    h.qform_code = 0;
    h.sform_code = 1;
    EXPECT_NE(error_of(header_bytes(h) + voxels_of<int16_t>(false), "qform").find("has no qform"), std::string::npos);
    h.sform.axes.setZero();
    EXPECT_NE(error_of(header_bytes(h) + voxels_of<int16_t>(false)).find("its axes lie in a plane"), std::string::npos);
}

TEST_F(NiftiFile, voxel_sizes_of_nothing_are_told) {
    for (int k = 0; k < 24; ++k) {
        Header h;
        h.second = k & 1;
        h.unit = k & 2 ? 1 : 2;
        h.qform_code = k / 4 % 2;
        h.pixdim = {2, 2, 2};
        const size_t axis = size_t(k / 8);
        h.pixdim[axis] = k & 4 ? 0 : std::nan("");
        const Volume volume = read(h);
        EXPECT_TRUE(warned(volume, "the voxel size along axis " + std::to_string(axis + 1) + " is 0 or no number")) << k;
        EXPECT_EQ(warned(volume, "has neither sform nor qform"), h.qform_code == 0) << k;
        const double unit = h.unit == 1 ? 1000 : 1;
        for (size_t i = 0; i < 3; ++i) EXPECT_NEAR(volume.step[i].norm(), unit * (i == axis ? 1 : 2), 1e-9) << k;
        h.sform_code = 2;
        EXPECT_FALSE(warned(read(h), "voxel size")) << k;  // the sform needs none
    }
}

TEST_F(NiftiFile, every_type_and_scale) {
    const auto check = [&](auto zero, int type, VoxelType expected) {
        using Value = decltype(zero);
        for (const bool big : {false, true}) {
            for (const double slope : {0.0, 1.0, 0.5}) {
                Header h;
                h.big = big;
                h.sform_code = 1;
                h.type = type;
                h.bits = 8 * sizeof(Value);
                h.slope = slope;
                h.shift = slope == 0.5 ? -3 : 0;
                const Volume volume = read_nifti(put("a.nii", header_bytes(h) + voxels_of<Value>(big)), "");
                EXPECT_EQ(volume.type, slope == 0.5 ? VoxelType::kDouble : expected);
                std::vector<std::pair<double, uint64_t>> values;
                for (size_t i = 0; i < 60; ++i) values.emplace_back(slope == 0.5 ? 0.5 * value_at(i) - 3 : value_at(i), 1);
                EXPECT_EQ(count_values(volume), values) << type << big << slope;
            }
        }
    };
    check(uint8_t{}, 2, VoxelType::kUint8);
    check(int8_t{}, 256, VoxelType::kInt8);
    check(uint16_t{}, 512, VoxelType::kUint16);
    check(int16_t{}, 4, VoxelType::kInt16);
    check(uint32_t{}, 768, VoxelType::kUint32);
    check(int32_t{}, 8, VoxelType::kInt32);
    check(uint64_t{}, 1280, VoxelType::kUint64);
    check(int64_t{}, 1024, VoxelType::kInt64);
    check(float{}, 16, VoxelType::kFloat);
    check(double{}, 64, VoxelType::kDouble);
    Header h;
    h.type = 128;
    EXPECT_NE(error_of(header_bytes(h) + voxels_of<int32_t>(false)).find("a voxel type this program does not take (128)"),
              std::string::npos);
}

TEST_F(NiftiFile, sizes_that_do_not_fit_are_told) {
    for (const bool second : {false, true}) {
        Header h;
        h.second = second;
        h.sform_code = 1;
        const std::string whole = header_bytes(h) + voxels_of<int16_t>(false), asked = std::to_string(whole.size());
        for (const size_t more : {1u, 2u, 60u, 5000u}) {
            const Volume longer = read_nifti(put("a.nii", whole + std::string(more, 'x')), "");
            EXPECT_TRUE(warned(longer, "its header asks for " + asked + " bytes, " + std::to_string(whole.size() + more) + " are there"));
            const Volume packed = read_nifti(put("a.nii.gz", gzip(whole + std::string(more, 'x'))), "");
            EXPECT_TRUE(warned(packed, "its header asks for " + asked));
        }
        for (size_t size = 0; size < whole.size(); size += 7) EXPECT_NE(error_of(whole.substr(0, size)), "no error") << size;
        EXPECT_NE(error_of(whole.substr(0, whole.size() - 1)).find("is cut short: its header asks for " + asked), std::string::npos);
        // any byte of the header may be damaged: no crash, and no voxel outside the file
        for (size_t at = 0; at < whole.size(); ++at) {
            for (const char bits : {'\x7f', '\xff', '\x80', '\1'}) {
                std::string bytes = whole;
                bytes[at] ^= bits;
                error_of(bytes);
            }
        }
    }
    std::string pair = header_bytes({});
    pair.replace(344, 3, "ni1");
    EXPECT_NE(error_of(pair).find("keeps its voxels in another file"), std::string::npos);
}

TEST_F(NiftiFile, the_file_whose_frames_differ) {
    const std::string file = reference::shared_data("reported/F07_nifti_two_frames/disagree.nii");
    if (!std::filesystem::exists(file)) GTEST_SKIP() << "the folder of real data is absent";
    const Volume volume = read_volume(file), other = read_volume(file, {"", "qform"});
    EXPECT_EQ(volume.origin, Vec3d(-40, 30, 10));
    EXPECT_EQ(volume.step[0], Vec3d(1.5, 0, 0));
    EXPECT_EQ(volume.step[1], Vec3d(0, -1.5, 0));
    EXPECT_TRUE(warned(volume, "mirror each other"));
    EXPECT_EQ(other.origin, Vec3d::Zero());
    EXPECT_EQ(other.step[0], Vec3d(-1.5, 0, 0));
}

}  // namespace
}  // namespace trocar
