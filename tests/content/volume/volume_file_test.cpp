#include "content/volume/volume_file.hpp"

#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "engine/files/child_process.hpp"
#include "reference/gzip.hpp"
#include "tests/content/mend/mesh_sums.hpp"
#include "tests/reference/shared_data.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

template <typename Value>
void put(std::string& bytes, Value value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

// A volume in closed form: 5 x 4 x 3 voxels, oblique, in LPS.
constexpr std::array<uint32_t, 3> kSize{5, 4, 3};
const Vec3d kOrigin(-31.5, 12.25, 100);
const std::array<Vec3d, 3> kDirection{Vec3d(0.6, 0.8, 0), Vec3d(-0.64, 0.48, 0.6), Vec3d(0.48, -0.36, 0.8)};
const Vec3d kSpacing(0.75, 1.5, 2.5);

int16_t value_at(uint32_t x, uint32_t y, uint32_t z) { return static_cast<int16_t>(x + 10 * y + 100 * z - 50); }

std::string voxel_bytes_of(uint32_t from_z = 0, uint32_t to_z = kSize[2]) {
    std::string bytes;
    for (uint32_t z = from_z; z < to_z; ++z) {
        for (uint32_t y = 0; y < kSize[1]; ++y) {
            for (uint32_t x = 0; x < kSize[0]; ++x) put(bytes, value_at(x, y, z));
        }
    }
    return bytes;
}

std::string number(double v) {
    char text[32];
    std::snprintf(text, sizeof text, "%.12g", v);
    return text;
}
std::string row(const Vec3d& v, const char* between) { return number(v.x()) + between + number(v.y()) + between + number(v.z()); }

std::string nrrd_text(const std::string& space, double flip) {
    std::string text = "NRRD0004\ntype: short\ndimension: 3\nspace: " + space + "\nsizes: 5 4 3\nspace directions:";
    const Vec3d f(flip, flip, 1);
    for (int k = 0; k < 3; ++k) text += " (" + row((kDirection[k] * kSpacing[k]).cwiseProduct(f), ",") + ")";
    return text + "\nkinds: domain domain domain\nendian: little\nencoding: raw\nspace origin: (" + row(kOrigin.cwiseProduct(f), ",") +
           ")\n\n";
}

std::string mha_text() {
    return "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nTransformMatrix = " +
           row(kDirection[0], " ") + " " + row(kDirection[1], " ") + " " + row(kDirection[2], " ") + "\nOffset = " + row(kOrigin, " ") +
           "\nElementSpacing = " + row(kSpacing, " ") + "\nDimSize = 5 4 3\nElementType = MET_SHORT\nElementDataFile = LOCAL\n";
}

// NIfTI-1 with an sform (RAS: x and y of LPS change sign).
std::string nifti_bytes() {
    std::string h(352, '\0');
    const auto set = [&](size_t at, auto value) { std::memcpy(h.data() + at, &value, sizeof value); };
    set(0, int32_t{348});
    const std::array<int16_t, 8> dim{3, 5, 4, 3, 1, 1, 1, 1};
    set(40, dim);
    set(70, int16_t{4});   // DT_INT16
    set(72, int16_t{16});  // bits
    const std::array<float, 8> pixdim{1, float(kSpacing.x()), float(kSpacing.y()), float(kSpacing.z()), 0, 0, 0, 0};
    set(76, pixdim);
    set(108, 352.0f);
    set(254, int16_t{1});  // sform_code
    for (int r = 0; r < 3; ++r) {
        const double flip = r < 2 ? -1 : 1;
        std::array<float, 4> line;
        for (int k = 0; k < 3; ++k) line[k] = float(flip * kDirection[k][r] * kSpacing[k]);
        line[3] = float(flip * kOrigin[r]);
        set(280 + 16 * size_t(r), line);
    }
    set(344, std::array<char, 4>{'n', '+', '1', '\0'});
    return h + voxel_bytes_of();
}

void put_element(std::string& bytes, uint16_t group, uint16_t element, const char* kind, std::string value) {
    if (value.size() % 2 == 1) value += kind[0] == 'U' && kind[1] == 'I' ? '\0' : ' ';
    put(bytes, group);
    put(bytes, element);
    bytes.append(kind, 2);
    if (std::string(kind) == "OW" || std::string(kind) == "OB") {
        put(bytes, uint16_t{0});
        put(bytes, static_cast<uint32_t>(value.size()));
    } else {
        put(bytes, static_cast<uint16_t>(value.size()));
    }
    bytes += value;
}
std::string short_value(uint16_t v) {
    std::string bytes;
    put(bytes, v);
    return bytes;
}

// One CT slice, explicit VR little endian, stored as half of (value + 1000): slope 2, intercept -1000.
std::string dicom_slice(uint32_t z, const std::string& series) {
    const std::string instance = "1.2.826.0.1.3680043.9.7." + series + "." + std::to_string(z + 1);
    const std::string ct = "1.2.840.10008.5.1.4.1.1.2";
    std::string meta, data;
    put_element(meta, 2, 1, "OB", std::string("\0\1", 2));
    put_element(meta, 2, 2, "UI", ct);
    put_element(meta, 2, 3, "UI", instance);
    put_element(meta, 2, 0x10, "UI", "1.2.840.10008.1.2.1");
    put_element(meta, 2, 0x12, "UI", "1.2.826.0.1.3680043.9.7");
    const Vec3d position = kOrigin + double(z) * kSpacing.z() * kDirection[2];
    put_element(data, 8, 0x16, "UI", ct);
    put_element(data, 8, 0x18, "UI", instance);
    put_element(data, 8, 0x60, "CS", "CT");
    put_element(data, 0x18, 0x50, "DS", number(kSpacing.z()));
    put_element(data, 0x20, 0x0d, "UI", "1.2.826.0.1.3680043.9.7.1");
    put_element(data, 0x20, 0x0e, "UI", "1.2.826.0.1.3680043.9.7.2." + series);
    put_element(data, 0x20, 0x13, "IS", std::to_string(10 - z));  // numbered opposite to the spatial order
    put_element(data, 0x20, 0x32, "DS", row(position, "\\"));
    put_element(data, 0x20, 0x37, "DS", row(kDirection[0], "\\") + "\\" + row(kDirection[1], "\\"));
    put_element(data, 0x28, 2, "US", short_value(1));
    put_element(data, 0x28, 4, "CS", "MONOCHROME2");
    put_element(data, 0x28, 0x10, "US", short_value(uint16_t(kSize[1])));
    put_element(data, 0x28, 0x11, "US", short_value(uint16_t(kSize[0])));
    put_element(data, 0x28, 0x30, "DS", number(kSpacing.y()) + "\\" + number(kSpacing.x()));  // between rows, columns
    put_element(data, 0x28, 0x100, "US", short_value(16));
    put_element(data, 0x28, 0x101, "US", short_value(16));
    put_element(data, 0x28, 0x102, "US", short_value(15));
    put_element(data, 0x28, 0x103, "US", short_value(1));
    put_element(data, 0x28, 0x1052, "DS", "-1000");
    put_element(data, 0x28, 0x1053, "DS", "2");
    std::string pixels;
    for (uint32_t y = 0; y < kSize[1]; ++y) {
        for (uint32_t x = 0; x < kSize[0]; ++x) put(pixels, static_cast<int16_t>((value_at(x, y, z) * 2 + 1000) / 2));
    }
    put_element(data, 0x7fe0, 0x10, "OW", pixels);
    std::string head;
    std::string length;
    put(length, static_cast<uint32_t>(meta.size()));
    put_element(head, 2, 0, "UL", length);
    return std::string(128, '\0') + "DICM" + head + meta + data;
}

double voxel(const Volume& volume, size_t i) {
    switch (volume.type) {
        case VoxelType::kInt16: {
            int16_t v;
            std::memcpy(&v, volume.voxels.data() + 2 * i, 2);
            return v;
        }
        case VoxelType::kInt32: {
            int32_t v;
            std::memcpy(&v, volume.voxels.data() + 4 * i, 4);
            return v;
        }
        default:
            ADD_FAILURE() << static_cast<int>(volume.type);
            return 0;
    }
}

void expect_closed_form(const Volume& volume, double scale, double offset) {
    ASSERT_EQ(volume.size, kSize);
    for (int k = 0; k < 3; ++k) {
        EXPECT_LT((volume.step[k] - kDirection[k] * kSpacing[k]).norm(), 2e-6) << k;
    }
    EXPECT_LT((volume.origin - kOrigin).norm(), 2e-5);
    for (uint32_t z = 0; z < 3; ++z) {
        for (uint32_t y = 0; y < 4; ++y) {
            for (uint32_t x = 0; x < 5; ++x) {
                ASSERT_EQ(voxel(volume, (z * 4 + y) * 5 + x), scale * value_at(x, y, z) + offset) << x << y << z;
            }
        }
    }
}

class VolumeFile : public FolderTest {
 protected:
    void SetUp() override {
        if (find_helper_program("trocar-volume-reader").empty()) GTEST_SKIP() << "built without ITK";
        FolderTest::SetUp();
    }
    std::string error_of(const fs::path& path, const std::string& series = {}) const {
        try {
            read_volume(path, {series});
        } catch (const InputError& error) {
            const std::string text = error.what();
            EXPECT_NE(text.find(path.filename().string()), std::string::npos) << text;
            EXPECT_EQ(text.find('\n'), std::string::npos) << text;
            return text;
        }
        return "no error";
    }
};

TEST_F(VolumeFile, NrrdKeepsOrientationSpacingAndValues) {
    expect_closed_form(read_volume(put("lps.nrrd", nrrd_text("left-posterior-superior", 1) + voxel_bytes_of())), 1, 0);
    expect_closed_form(read_volume(put("ras.nrrd", nrrd_text("right-anterior-superior", -1) + voxel_bytes_of())), 1, 0);
}

TEST_F(VolumeFile, MetaImageKeepsOrientationSpacingAndValues) {
    expect_closed_form(read_volume(put("a.mha", mha_text() + voxel_bytes_of())), 1, 0);
    std::string head = mha_text();
    std::string packed(200, '\0');
    uLongf length = 200;
    const std::string plain = voxel_bytes_of();
    ASSERT_EQ(compress(reinterpret_cast<Bytef*>(packed.data()), &length, reinterpret_cast<const Bytef*>(plain.data()), plain.size()), Z_OK);
    packed.resize(length);
    head.insert(head.find("DimSize"), "CompressedData = True\nCompressedDataSize = " + std::to_string(length) + "\n");
    expect_closed_form(read_volume(put("z.mha", head + packed)), 1, 0);
    EXPECT_NE(error_of(put("z.mha", head + packed.substr(0, length / 2))).find("cut short"), std::string::npos);
}

TEST_F(VolumeFile, NiftiKeepsOrientationSpacingAndValues) {
    expect_closed_form(read_volume(put("a.nii", nifti_bytes())), 1, 0);
    expect_closed_form(read_volume(put("a.nii.gz", gzip(nifti_bytes()))), 1, 0);
}

TEST_F(VolumeFile, DicomSlicesAreOrderedByPlaceAndScaled) {
    put("s/c.dcm", dicom_slice(0, "1"));
    put("s/a.dcm", dicom_slice(1, "1"));
    put("s/b.dcm", dicom_slice(2, "1"));
    put("s/readme.txt", "no slice");
    expect_closed_form(read_volume(folder / "s"), 2, 0);
    const Volume one = read_volume(folder / "s/a.dcm");
    EXPECT_EQ(one.size, (std::array<uint32_t, 3>{5, 4, 1}));
    EXPECT_LT((one.step[2] - kDirection[2] * kSpacing.z()).norm(), 1e-6) << "a lone slice is as thick as it says";
}

TEST_F(VolumeFile, DicomSeriesThatAreNotWholeAreRefused) {
    put("gap/a.dcm", dicom_slice(0, "1"));
    put("gap/b.dcm", dicom_slice(1, "1"));
    put("gap/d.dcm", dicom_slice(3, "1"));
    EXPECT_NE(error_of(folder / "gap").find("even distances"), std::string::npos) << error_of(folder / "gap");
    put("two/a.dcm", dicom_slice(0, "1"));
    put("two/b.dcm", dicom_slice(1, "1"));
    put("two/c.dcm", dicom_slice(2, "1"));
    put("two/d.dcm", dicom_slice(0, "5"));
    EXPECT_NE(error_of(folder / "two").find("holds 2 DICOM series"), std::string::npos) << error_of(folder / "two");
    expect_closed_form(read_volume(folder / "two", {"1.2.826.0.1.3680043.9.7.2.1"}), 2, 0);
    EXPECT_NE(error_of(folder / "two", "9").find("no DICOM series 9"), std::string::npos);
    put("none/a.txt", "nothing");
    EXPECT_NE(error_of(folder / "none").find("no DICOM slices"), std::string::npos);
}

TEST_F(VolumeFile, WhatIsCutShortIsRefused) {
    const std::string nifti = nifti_bytes(), packed = gzip(nifti);
    for (const size_t cut : {1u, 100u}) {
        EXPECT_NE(error_of(put("a.nii", nifti.substr(0, nifti.size() - cut))).find("cut short"), std::string::npos) << cut;
        // a complete gzip stream with too few voxels
        EXPECT_NE(error_of(put("a.nii.gz", gzip(nifti.substr(0, nifti.size() - cut)))).find("cut short"), std::string::npos);
    }
    for (size_t keep = 0; keep < packed.size(); keep += 80) {
        EXPECT_NE(error_of(put("b.nii.gz", packed.substr(0, keep))), "no error") << keep;
    }
    const std::string nrrd = nrrd_text("left-posterior-superior", 1) + voxel_bytes_of(), mha = mha_text() + voxel_bytes_of();
    EXPECT_NE(error_of(put("a.nrrd", nrrd.substr(0, nrrd.size() - 3))), "no error");
    EXPECT_NE(error_of(put("b.nrrd", nrrd.substr(0, 60))), "no error");
    EXPECT_NE(error_of(put("a.mha", mha.substr(0, mha.size() - 3))), "no error");
    EXPECT_NE(error_of(put("b.mha", mha.substr(0, 100))), "no error");
    std::string split = mha_text();
    split.replace(split.find("LOCAL"), 5, "a.raw");
    put("a.raw", voxel_bytes_of());
    expect_closed_form(read_volume(put("split.mhd", split)), 1, 0);
    put("a.raw", voxel_bytes_of().substr(1));
    EXPECT_NE(error_of(put("split.mhd", split)).find("cut short"), std::string::npos);
    const std::string slice = dicom_slice(0, "1");
    EXPECT_NE(error_of(put("a.dcm", slice.substr(0, slice.size() - 5))), "no error");
}

// Headers that name voxel files elsewhere. These exist and have the right size, so that only the location can
// be the reason.
TEST_F(VolumeFile, VoxelsLieBelowTheFolderOfTheirHeader) {
    const fs::path outside = folder / "outside", inside = folder / "inside";
    fs::create_directories(outside);
    fs::create_directories(inside / "deeper");
    for (const fs::path& p : {outside / "a.raw", inside / "deeper/a.raw"}) {
        std::ofstream(p, std::ios::binary) << voxel_bytes_of();
    }
    fs::create_symlink(outside / "a.raw", inside / "link.raw");
    const auto mha = [&](const std::string& name) {
        std::string text = mha_text();
        return text.replace(text.find("LOCAL"), 5, name);
    };
    const auto nrrd = [&](const std::string& name) {
        std::string text = nrrd_text("left-posterior-superior", 1);
        return text.insert(text.size() - 1, "data file: " + name + "\n");
    };
    expect_closed_form(read_volume(put("inside/a.mhd", mha("deeper/a.raw"))), 1, 0);
    expect_closed_form(read_volume(put("inside/a.nhdr", nrrd("deeper/a.raw"))), 1, 0);
    for (const std::string& name : {std::string("../outside/a.raw"), (outside / "a.raw").string(), std::string("link.raw"),
                                    std::string("deeper/../../outside/a.raw")}) {
        EXPECT_NE(error_of(put("inside/a.mhd", mha(name))).find("outside the folder"), std::string::npos) << name;
        EXPECT_NE(error_of(put("inside/a.nhdr", nrrd(name))).find("outside the folder"), std::string::npos) << name;
        EXPECT_NE(error_of(put("inside/a.mhd", mha("LIST\n" + name))).find("outside the folder"), std::string::npos) << name;
    }
    EXPECT_NE(error_of(put("inside/a.mhd", mha("../outside/%d.raw 1 3 1"))).find("beside their header"), std::string::npos);
}

TEST_F(VolumeFile, WhatIsNoVolumeIsRefusedInOneLine) {
    EXPECT_NE(error_of(folder / "nothing.nrrd").find("no such file"), std::string::npos);
    EXPECT_NE(error_of(put("a.xyz", "not a volume")).find("not a volume"), std::string::npos);
    EXPECT_NE(error_of(put("a.nrrd", "not a volume")), "no error");
    EXPECT_NE(error_of(put("a.nii", std::string(400, 'x'))), "no error");
    EXPECT_NE(error_of(put("a.mha", "")), "no error");
    std::string huge = nrrd_text("left-posterior-superior", 1);
    huge.replace(huge.find("sizes: 5 4 3"), 12, "sizes: 100000 100000 100000");
    EXPECT_NE(error_of(put("huge.nrrd", huge + voxel_bytes_of())).find("4 GiB"), std::string::npos);
    std::string colour = nrrd_text("left-posterior-superior", 1);
    colour.replace(colour.find("dimension: 3"), 12, "dimension: 4");
    colour.replace(colour.find("sizes: 5 4 3"), 12, "sizes: 3 5 4 1");
    colour.replace(colour.find("directions: ("), 13, "directions: none (");
    colour.replace(colour.find("kinds: domain"), 13, "kinds: RGB-color domain");
    EXPECT_NE(error_of(put("colour.nrrd", colour + voxel_bytes_of())).find("3 values a voxel"), std::string::npos)
        << error_of(put("colour.nrrd", colour + voxel_bytes_of()));
}

bool says(const Volume& volume, const std::string& part) {
    return std::any_of(volume.warnings.begin(), volume.warnings.end(),
                       [&](const std::string& w) { return w.find(part) != std::string::npos; });
}

// Segmentations of 3D Slicer: segments of one layer or of several that overlap, the layer as the first axis or as the last.
TEST_F(VolumeFile, SegmentsAreNamedAndLieInLayers) {
    for (int k = 0; k < 24; ++k) {
        const uint32_t layers = 1 + uint32_t(k) % 4;
        const bool first = k / 4 % 2, packed = k / 8 % 3 == 1, named = k / 8 % 3 != 2;
        const auto inside = [](uint32_t layer, uint32_t i) { return (i * 7 + 3 * layer) % (3 + layer) == 0; };
        std::string voxels, head = "NRRD0004\ntype: unsigned char\nspace: left-posterior-superior\n";
        std::vector<uint64_t> count(layers, 0);
        for (uint32_t a = 0; a < (first ? 60 : layers); ++a) {
            for (uint32_t b = 0; b < (first ? layers : 60); ++b) {
                const uint32_t layer = first ? b : a, i = first ? a : b;
                voxels += inside(layer, i) ? char(layers == 1 ? 7 : 1 + (named ? layer : 0)) : '\0';
                count[layer] += inside(layer, i);
            }
        }
        const std::string axes = "(2,0,0) (0,3,0) (0,0,4)";
        if (layers == 1) head += "dimension: 3\nsizes: 5 4 3\nspace directions: " + axes + "\nkinds: domain domain domain\n";
        const std::string n = std::to_string(layers);
        if (layers > 1 && first)
            head += "dimension: 4\nsizes: " + n + " 5 4 3\nspace directions: none " + axes + "\nkinds: list domain domain domain\n";
        if (layers > 1 && !first)
            head += "dimension: 4\nsizes: 5 4 3 " + n + "\nspace directions: " + axes + " none\nkinds: domain domain domain list\n";
        head += std::string("encoding: ") + (packed ? "gzip" : "raw") + "\nspace origin: (1,2,3)\n";
        for (uint32_t s = 0; s < layers; ++s) {
            const std::string key = "Segment" + std::to_string(s) + "_";
            head += key + "ID:=Segment_" + std::to_string(s) + "\n" + key + "Name:=Part number " + std::to_string(s) + "\n" + key +
                    "Tags:=Segmentation.Status:inprogress|" + std::string(4000, 't') + "\n";
            if (layers == 1) head += key + "LabelValue:=7\n" + key + "Layer:=0\n";
            if (layers > 1 && named)
                head += key + "LabelValue:=" + std::to_string(1 + s) + "\n" + key + "Layer:=" + std::to_string(s) + "\n";
        }
        const Volume volume = read_volume(put("a.seg.nrrd", head + "\n" + (packed ? gzip(voxels) : voxels)));
        EXPECT_EQ(volume.layers, layers) << k;
        EXPECT_TRUE(volume.warnings.empty()) << k << volume.warnings[0];
        ASSERT_EQ(volume.segments.size(), layers) << k;
        EXPECT_EQ(volume.origin, Vec3d(1, 2, 3)) << k;
        EXPECT_EQ(volume.step[2], Vec3d(0, 0, 4)) << k;
        for (uint32_t s = 0; s < layers; ++s) {
            EXPECT_EQ(volume.segments[s].name, "Part number " + std::to_string(s));
            EXPECT_EQ(volume.segments[s].id, "Segment_" + std::to_string(s));
            EXPECT_EQ(volume.segments[s].layer, s);
            const Volume one = take_layer(volume, s);
            const double label = volume.segments[s].label;
            EXPECT_EQ(count_values(one), (std::vector<std::pair<double, uint64_t>>{{0, 60 - count[s]}, {label, count[s]}}))
                << k << ' ' << s;
        }
    }
    std::string beyond = nrrd_text("left-posterior-superior", 1);
    beyond.insert(beyond.size() - 1, "Segment0_Name:=Far\nSegment0_Layer:=3\n");
    EXPECT_NE(error_of(put("b.seg.nrrd", beyond + voxel_bytes_of())).find("segment \"Far\" is in layer 3 of 1"), std::string::npos);
}

// Voxels that are more or fewer than the header says, behind it or in a file of their own, packed or not.
TEST_F(VolumeFile, SizesThatDoNotFitAreTold) {
    const std::string plain = voxel_bytes_of(), nrrd = nrrd_text("left-posterior-superior", 1);
    const auto with = [](std::string text, const std::string& from, const std::string& to) {
        return text.replace(text.find(from), from.size(), to);
    };
    const std::string other = with(nrrd, "raw\n", "raw\ndata file: v.raw\n"), gz = with(nrrd, "raw", "gzip"),
                      other_gz = with(other, "raw\n", "gzip\n");
    const std::string skip = with(other, "raw\n", "raw\nbyte skip: 4\n"), last = with(other, "raw\n", "raw\nbyte skip: -1\n");
    const std::string mhd = with(mha_text(), "LOCAL", "v.raw");
    const auto read = [&](const std::string& head, bool packed, const std::string& voxels) {
        const std::string bytes = packed ? gzip(voxels) : voxels;
        const bool apart = head.find("v.raw") != std::string::npos, meta = head.starts_with("Object");
        if (apart) put("v.raw", bytes);
        return put(meta ? "a.mhd" : "a.nrrd", apart ? head : head + bytes);
    };
    for (const int more : {-120, -60, -1, 0, 1, 2, 60, 4000}) {
        const std::string voxels = more < 0 ? plain.substr(0, plain.size() - size_t(-more)) : plain + std::string(size_t(more), 'x');
        for (const auto& [head, packed] :
             {std::pair{nrrd, false}, {other, false}, {gz, true}, {other_gz, true}, {mha_text(), false}, {mhd, false}}) {
            const fs::path path = read(head, packed, voxels);
            SCOPED_TRACE(head + std::to_string(more));
            if (more < 0) {
                EXPECT_NE(error_of(path), "no error");
                continue;
            }
            const Volume volume = read_volume(path);
            expect_closed_form(volume, 1, 0);
            EXPECT_EQ(says(volume, "is longer than it says, and the end is passed over: its header asks for 120 bytes, " +
                                       std::to_string(120 + more) + " are there"),
                      more > 0);
        }
    }
    EXPECT_NE(error_of(read(mhd, false, plain.substr(1))).find("its header asks for 120 bytes, 119 are there"), std::string::npos);
    EXPECT_NE(error_of(read(other, false, plain.substr(1))).find("119"), std::string::npos)
        << error_of(read(other, false, plain.substr(1)));
    expect_closed_form(read_volume(read(skip, false, "head" + plain)), 1, 0);
    EXPECT_TRUE(read_volume(read(skip, false, "head" + plain)).warnings.empty());
    EXPECT_TRUE(says(read_volume(read(skip, false, "head" + plain + "x")), "124 bytes, 125 are there"));
    expect_closed_form(read_volume(read(last, false, "any head" + plain)), 1, 0);
    EXPECT_TRUE(read_volume(read(last, false, "any head" + plain)).warnings.empty());
}

// The stream from the child process is validated: each modification of it is rejected.
TEST(VolumeStream, EveryUnsoundHeaderIsRefused) {
    VolumeStreamHeader good;
    good.type = static_cast<uint32_t>(VoxelType::kInt16);
    for (int k = 0; k < 3; ++k) {
        good.size[k] = kSize[k];
        good.origin[k] = kOrigin[k];
        good.spacing[k] = kSpacing[k];
        for (int c = 0; c < 3; ++c) good.direction[3 * k + c] = kDirection[k][c];
    }
    good.voxel_bytes = 120;
    const auto stream = [](const VolumeStreamHeader& h) {
        return std::string(reinterpret_cast<const char*>(&h), sizeof h) + voxel_bytes_of();
    };
    expect_closed_form(decode_volume_stream(stream(good)), 1, 0);
    const double nan = std::nan(""), inf = INFINITY;
    const std::vector<std::function<void(VolumeStreamHeader&)>> faults{
        [](auto& h) { h.magic[3] = 'x'; },
        [](auto& h) { h.version = 1; },
        [](auto& h) { h.layers = 0; },
        [](auto& h) { h.layers = 2; },
        [](auto& h) { h.layers = uint64_t{1} << 63; },
        [](auto& h) { h.type = 10; },
        [](auto& h) { h.type = 0; },
        [](auto& h) { h.size[1] = 0; },
        [](auto& h) { h.size[2] = 4; },
        [](auto& h) { h.size[0] = uint64_t{1} << 63; },
        [](auto& h) { h.size[0] = h.size[1] = h.size[2] = 1u << 20, h.voxel_bytes = uint64_t{1} << 61; },
        [](auto& h) { h.voxel_bytes = 119; },
        [=](auto& h) { h.origin[1] = nan; },
        [=](auto& h) { h.origin[2] = inf; },
        [](auto& h) { h.spacing[0] = 0; },
        [](auto& h) { h.spacing[2] = -1; },
        [=](auto& h) { h.spacing[1] = nan; },
        [=](auto& h) { h.spacing[1] = inf; },
        [](auto& h) { h.direction[4] = 3; },
        [=](auto& h) { h.direction[8] = nan; },
        [](auto& h) { std::copy(h.direction, h.direction + 3, h.direction + 3); },
    };
    for (size_t k = 0; k < faults.size(); ++k) {
        VolumeStreamHeader bad = good;
        faults[k](bad);
        EXPECT_THROW(decode_volume_stream(stream(bad)), InputError) << k;
    }
    EXPECT_THROW(decode_volume_stream(stream(good) + "x"), InputError);
    EXPECT_THROW(decode_volume_stream(stream(good).substr(0, 295)), InputError);
    EXPECT_THROW(decode_volume_stream(stream(good).substr(0, 100)), InputError);
    EXPECT_THROW(decode_volume_stream(""), InputError);
}

// Affine maps as read by nibabel 5.0 and pydicom 2.3; NIfTI is RAS, ours is LPS.
TEST_F(VolumeFile, RealFilesLieWhereNibabelAndPydicomSay) {
    if (shared_data_folder().empty()) GTEST_SKIP() << "the folder of real data is absent";
    struct Expected {
        const char* file;
        std::array<uint32_t, 3> size;
        VoxelType type;
        Vec3d origin, step_x, step_y, step_z;
    };
    const std::vector<Expected> files{
        {"abdomen_labels_v1_122x101x112_3mm.nii.gz",
         {122, 101, 112},
         VoxelType::kDouble,
         {177.95632934570312, -11.319000244140625, 94.3017578125},
         {-3, 0, 0},
         {0, -3, 0},
         {0, 0, 3}},
        {"abdomen_ct_122x101x112_3mm.nii.gz",
         {122, 101, 112},
         VoxelType::kInt32,
         {177.95632934570312, -11.319000244140625, 94.3017578125},
         {-3, 0, 0},
         {0, -3, 0},
         {0, 0, 3}},
        {"abdomen_labels_u8.nrrd",
         {122, 101, 112},
         VoxelType::kUint8,
         {177.95632934570312, -11.319000244140625, 94.3017578125},
         {-3, 0, 0},
         {0, -3, 0},
         {0, 0, 3}},
        {"anatomical.nii", {33, 41, 25}, VoxelType::kInt16, {-32, 40, -16}, {2, 0, 0}, {0, -2, 0}, {0, 0, 2}},
        {"reoriented_anat_moved.nii",
         {21, 26, 22},
         VoxelType::kFloat,
         {35.29789733886719, 47.97758483886719, -27.599409103393555},
         {-4, 0, 0},
         {0, -4, 0},
         {0, 0, 4}},
        {"CT_small.dcm",
         {128, 128, 1},
         VoxelType::kInt32,
         {-158.135803, -179.035797, -75.699997},
         {0.661468, 0, 0},
         {0, 0.661468, 0},
         {0, 0, 5}},
    };
    for (const Expected& e : files) {
        const Volume volume = read_volume(reference::shared_data(std::string("volumes/") + e.file));
        EXPECT_EQ(volume.size, e.size) << e.file;
        EXPECT_LT((volume.origin - e.origin).norm(), 1e-5) << e.file;
        EXPECT_LT((volume.step[0] - e.step_x).norm() + (volume.step[1] - e.step_y).norm() + (volume.step[2] - e.step_z).norm(), 1e-6)
            << e.file;
        EXPECT_EQ(volume.type, e.type) << e.file << ' ' << static_cast<int>(volume.type);
    }
    // the same labels, once as uint8 in NRRD and once as double in NIfTI
    const Volume bytes = read_volume(reference::shared_data("volumes/abdomen_labels_u8.nrrd"));
    const Volume doubles = read_volume(reference::shared_data("volumes/abdomen_labels_v1_122x101x112_3mm.nii.gz"));
    EXPECT_EQ(count_values(bytes), count_values(doubles));
}

}  // namespace
}  // namespace trocar
