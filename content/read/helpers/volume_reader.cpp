#include <itkGDCMImageIO.h>
#include <itkGDCMSeriesFileNames.h>
#include <itkMetaDataObject.h>
#include <itkMetaImageIO.h>
#include <itkNrrdImageIO.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <new>
#include <string_view>

#include "content/volume/volume_stream.hpp"
#include "engine/base/error.hpp"
#include "engine/files/child_process.hpp"

// trocar-volume-reader FILE-OR-FOLDER [SERIES] > STREAM
// Reads a volume with ITK and writes it in the format of content/volume/volume_stream.hpp. It is a separate program
// because ITK is large and its readers are not robust against damaged files; content/volume/volume_file.hpp runs it
// within limits. SERIES is the UID of a DICOM series; empty = the only one. Exit codes: 0 read, 1 not read
// (the last line of standard error has the reason), kChildOutOfMemory. A warning is a last line "warning: ...".
namespace trocar {
namespace {

namespace fs = std::filesystem;
using ImageIO = itk::ImageIOBase;

[[noreturn]] void fail(const std::string& reason) { throw InputError(reason); }

std::string lower_case(std::string text) {
    for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c | 0x20) : c;
    return text;
}

std::string trimmed(const std::string& text) {
    const size_t begin = text.find_first_not_of(" \t\r"), end = text.find_last_not_of(" \t\r");
    return begin == std::string::npos ? "" : text.substr(begin, end - begin + 1);
}

VoxelType voxel_type(const ImageIO& io) {
    const size_t bytes = io.GetComponentSize();
    const auto sized = [&](VoxelType one, VoxelType two, VoxelType four, VoxelType eight) {
        return bytes == 1 ? one : bytes == 2 ? two : bytes == 4 ? four : eight;
    };
    switch (io.GetComponentType()) {
        case itk::IOComponentEnum::UCHAR:
        case itk::IOComponentEnum::USHORT:
        case itk::IOComponentEnum::UINT:
        case itk::IOComponentEnum::ULONG:
        case itk::IOComponentEnum::ULONGLONG:
            return sized(VoxelType::kUint8, VoxelType::kUint16, VoxelType::kUint32, VoxelType::kUint64);
        case itk::IOComponentEnum::CHAR:
        case itk::IOComponentEnum::SHORT:
        case itk::IOComponentEnum::INT:
        case itk::IOComponentEnum::LONG:
        case itk::IOComponentEnum::LONGLONG:
            return sized(VoxelType::kInt8, VoxelType::kInt16, VoxelType::kInt32, VoxelType::kInt64);
        case itk::IOComponentEnum::FLOAT:
            return VoxelType::kFloat;
        case itk::IOComponentEnum::DOUBLE:
            return VoxelType::kDouble;
        default:
            fail("a voxel type this program does not take (" + io.GetComponentTypeAsString(io.GetComponentType()) + ")");
    }
}

// Reads the file's metadata, without voxels.
VolumeStreamHeader describe(const ImageIO& io) {
    const unsigned dimensions = io.GetNumberOfDimensions();
    for (unsigned k = 3; k < dimensions; ++k) {
        if (io.GetDimensions(k) > 1) fail("has " + std::to_string(dimensions) + " dimensions; three are needed");
    }
    if (dimensions < 2) fail("has one dimension; three are needed");
    VolumeStreamHeader header;
    header.type = static_cast<uint32_t>(voxel_type(io));
    header.layers = io.GetNumberOfComponents();
    header.voxel_bytes = io.GetComponentSize() * header.layers;
    for (unsigned k = 0; k < 3; ++k) {
        const bool there = k < dimensions;
        header.size[k] = there ? io.GetDimensions(k) : 1;
        header.origin[k] = there ? io.GetOrigin(k) : 0;
        header.spacing[k] = there ? io.GetSpacing(k) : 1;
        const std::vector<double> axis = there ? io.GetDirection(k) : std::vector<double>{0, 0, 1};
        for (unsigned c = 0; c < 3; ++c) header.direction[3 * k + c] = c < axis.size() ? axis[c] : 0;
        if (header.size[k] == 0) fail("has a side without voxels");
        if (header.size[k] > kVoxelBytesLimit / header.voxel_bytes) fail("claims more voxels than 4 GiB hold");
        header.voxel_bytes *= header.size[k];
    }
    return header;
}

void write_bytes(const void* bytes, size_t count) {
    if (std::fwrite(bytes, 1, count, stdout) != count) fail("cannot write to the standard output");
}

std::vector<char> read_voxels(ImageIO& io, size_t bytes) {
    std::vector<char> voxels(bytes);
    const unsigned dimensions = io.GetNumberOfDimensions();
    itk::ImageIORegion region(dimensions);
    for (unsigned k = 0; k < dimensions; ++k) region.SetSize(k, io.GetDimensions(k));
    io.SetIORegion(region);
    io.Read(voxels.data());
    return voxels;
}

std::string file_bytes(const fs::path& path) {
    std::ifstream stream(path, std::ios::binary);
    if (!stream) fail(path.filename().string() + " cannot be opened");
    return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

// Uncompressed size of a zlib stream, bytes; of a damaged one up to the damage.
uint64_t inflated_bytes(std::string_view packed) {
    z_stream stream{};
    if (inflateInit2(&stream, 15 + 32) != Z_OK) fail("cannot start unpacking");
    std::vector<char> buffer(1 << 20);
    uint64_t total = 0;
    int state = Z_OK;
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
    stream.avail_in = static_cast<uInt>(packed.size());
    while (state == Z_OK) {
        stream.next_out = reinterpret_cast<Bytef*>(buffer.data());
        stream.avail_out = static_cast<uInt>(buffer.size());
        state = inflate(&stream, Z_NO_FLUSH);
        total += buffer.size() - stream.avail_out;
    }
    inflateEnd(&stream);
    return total;
}

struct TextHeader {
    size_t bytes = 0;
    std::map<std::string, std::string> value;  // by key in lower case
};

// Lines "key: value" up to an empty line (NRRD), or "Key = value" up to ElementDataFile (MetaImage).
TextHeader read_text_header(const fs::path& path) {
    TextHeader header;
    std::ifstream stream(path, std::ios::binary);
    std::string line;
    for (bool last = false; !last && std::getline(stream, line);) {
        header.bytes += line.size() + 1;
        line = trimmed(line);
        const size_t between = line.find_first_of(":=");
        const std::string key = lower_case(trimmed(line.substr(0, between)));
        last = line.empty() || key == "elementdatafile";
        if (between != std::string::npos) header.value.emplace(key, trimmed(line.substr(between + 1)));
    }
    return header;
}

// ITK takes voxels that are cut short (MetaImage) or go on after their end. They follow the header, or are one file of their
// own; lists of files are left to ITK.
void check_length(const fs::path& path, uint64_t wanted) {
    const TextHeader header = read_text_header(path);
    const auto value = [&](const char* key) { return header.value.contains(key) ? header.value.at(key) : std::string(); };
    const std::string name = value("elementdatafile") + value("data file") + value("datafile"), coding = lower_case(value("encoding"));
    const std::string word = lower_case(name).substr(0, 4);
    if (word == "list" || name.find('%') != std::string::npos) return;
    const bool packed = coding == "gzip" || coding == "gz" || lower_case(value("compresseddata")) == "true";
    if ((!coding.empty() && !packed && coding != "raw") || header.value.contains("line skip") || header.value.contains("lineskip")) return;
    const bool attached = name.empty() || lower_case(name) == "local";
    const fs::path file = attached ? path : path.parent_path() / name;
    const uint64_t begin = attached ? std::min<uint64_t>(header.bytes, fs::file_size(file)) : 0;
    const uint64_t count = packed ? inflated_bytes(std::string_view(file_bytes(file)).substr(begin)) : fs::file_size(file) - begin;
    const std::string skip = value("byte skip") + value("byteskip") + value("headersize");  // -1: the voxels are the last bytes
    const uint64_t asked = wanted + (skip.empty() ? 0 : std::strtoull(skip.c_str(), nullptr, 10) * (skip[0] != '-'));
    const std::string sizes = "its header asks for " + std::to_string(asked) + " bytes, " + std::to_string(count) + " are there";
    if (count < asked) fail("is cut short: " + sizes);
    if (count > asked && skip[0] != '-')
        std::fprintf(stderr, "warning: is longer than it says, and the end is passed over: %s\n", sizes.c_str());
}

// ITK also accepts a DICOM file with truncated pixels. PixelData (7FE0,0010) is the last element with that
// tag, explicit or implicit VR, little endian; compressed pixels end with a delimiter (FFFE,E0DD).
void check_dicom_length(const fs::path& path) {
    const std::string bytes = file_bytes(path);
    const size_t tag = bytes.rfind(std::string("\xe0\x7f\x10\x00", 4));
    if (tag == std::string::npos) return;  // big endian: left to ITK
    const bool named = bytes.compare(tag + 4, 2, "OW") == 0 || bytes.compare(tag + 4, 2, "OB") == 0;
    const size_t begin = tag + (named ? 12 : 8);
    if (begin > bytes.size()) fail(path.filename().string() + " is cut short");
    uint32_t length = 0;
    std::memcpy(&length, bytes.data() + begin - 4, 4);
    const bool whole =
        length == UINT32_MAX ? bytes.find(std::string("\xfe\xff\xdd\xe0", 4), begin) != std::string::npos : length <= bytes.size() - begin;
    if (!whole) fail(path.filename().string() + " is cut short within its pixels");
}

void write_file(const fs::path& path, ImageIO& io) {
    io.SetFileName(path.string());
    io.ReadImageInformation();
    const VolumeStreamHeader header = describe(io);
    check_length(path, header.voxel_bytes);
    const std::vector<char> voxels = read_voxels(io, header.voxel_bytes);
    write_bytes(&header, sizeof header);
    write_bytes(voxels.data(), voxels.size());
}

// One slice of a DICOM series with its position along the normal.
struct Slice {
    std::string file;
    VolumeStreamHeader header;
    double along = 0;
};

// For a single slice ITK reports a spacing of 1; SliceThickness (0018,0050) is correct.
double slice_thickness(const itk::GDCMImageIO& io) {
    std::string text;
    if (!itk::ExposeMetaData<std::string>(io.GetMetaDataDictionary(), "0018|0050", text)) return 1;
    const double thickness = std::atof(text.c_str());
    return thickness > 0 && std::isfinite(thickness) ? thickness : 1;
}

// Sorts the slices by position. All must agree in size, type, in-plane spacing and direction and be evenly
// spaced (to 1 % of the spacing): a missing slice would shift everything above it.
std::vector<Slice> order_slices(const std::vector<std::string>& files) {
    std::vector<Slice> slices;
    for (const std::string& file : files) {
        check_dicom_length(file);
        const auto io = itk::GDCMImageIO::New();
        io->SetFileName(file);
        io->ReadImageInformation();
        Slice slice{file, describe(*io), 0};
        if (files.size() == 1 && slice.header.size[2] == 1) slice.header.spacing[2] = slice_thickness(*io);
        const VolumeStreamHeader& h = slice.header;
        const VolumeStreamHeader& first = slices.empty() ? h : slices[0].header;
        const std::string name = fs::path(file).filename().string();
        if (h.size[2] != 1 && files.size() > 1) fail(name + ": holds several slices, among others with one");
        if (h.type != first.type || h.size[0] != first.size[0] || h.size[1] != first.size[1]) {
            fail(name + ": size or type differ from those of " + fs::path(files[0]).filename().string());
        }
        for (int c = 0; c < 9; ++c) {
            if (!(std::abs(h.direction[c] - first.direction[c]) < 1e-4)) fail(name + ": the slice is turned against the others");
        }
        for (int c = 0; c < 2; ++c) {
            if (!(std::abs(h.spacing[c] / first.spacing[c] - 1) < 1e-4)) fail(name + ": the spacing differs from the others");
        }
        for (int c = 0; c < 3; ++c) slice.along += first.direction[6 + c] * h.origin[c];
        slices.push_back(std::move(slice));
    }
    std::stable_sort(slices.begin(), slices.end(), [](const Slice& a, const Slice& b) { return a.along < b.along; });
    return slices;
}

void check_gaps(const std::vector<Slice>& slices) {
    const double mean = (slices.back().along - slices.front().along) / double(slices.size() - 1);
    if (!(mean > 0)) fail("all slices lie at one place");
    for (size_t k = 1; k < slices.size(); ++k) {
        const double gap = slices[k].along - slices[k - 1].along;
        if (std::abs(gap - mean) < 0.01 * mean) continue;
        char text[96];
        std::snprintf(text, sizeof text, " are %.6g apart, the mean is %.6g", gap, mean);
        fail("slices are not at even distances (one missing, or doubled): " + fs::path(slices[k - 1].file).filename().string() + " and " +
             fs::path(slices[k].file).filename().string() + text);
    }
}

// Derives the third axis from the slice positions: a tilted gantry shifts slices sideways.
void set_third_axis(const std::vector<Slice>& slices, VolumeStreamHeader& header) {
    if (slices.size() < 2) return;
    check_gaps(slices);
    std::array<double, 3> step{};
    double length = 0;
    for (int c = 0; c < 3; ++c) {
        step[c] = (slices.back().header.origin[c] - slices.front().header.origin[c]) / double(slices.size() - 1);
        length = std::hypot(length, step[c]);
    }
    for (int c = 0; c < 3; ++c) header.direction[6 + c] = step[c] / length;
    header.spacing[2] = length;
}

std::vector<std::string> series_files(const fs::path& folder, const std::string& series) {
    const auto names = itk::GDCMSeriesFileNames::New();
    names->SetUseSeriesDetails(false);
    names->SetDirectory(folder.string());
    const std::vector<std::string> all = names->GetSeriesUIDs();
    if (all.empty()) fail("no DICOM slices in this folder");
    if (series.empty() && all.size() > 1) {
        std::string list;
        for (const std::string& uid : all) list += (list.empty() ? "" : ", ") + uid;
        fail("holds " + std::to_string(all.size()) + " DICOM series; choose one: " + list);
    }
    if (!series.empty() && std::find(all.begin(), all.end(), series) == all.end()) fail("has no DICOM series " + series);
    return names->GetFileNames(series.empty() ? all[0] : series);
}

void write_series(const std::vector<std::string>& files) {
    const std::vector<Slice> slices = order_slices(files);
    VolumeStreamHeader header = slices[0].header;
    if (slices.size() > 1) {
        header.size[2] = slices.size();
        header.voxel_bytes *= slices.size();
        if (header.voxel_bytes > kVoxelBytesLimit) fail("claims more voxels than 4 GiB hold");
    }
    set_third_axis(slices, header);
    write_bytes(&header, sizeof header);
    for (const Slice& slice : slices) {
        const auto io = itk::GDCMImageIO::New();
        io->SetFileName(slice.file);
        io->ReadImageInformation();
        const std::vector<char> voxels = read_voxels(*io, slice.header.voxel_bytes);
        write_bytes(voxels.data(), voxels.size());
    }
}

void write_volume(const fs::path& path, const std::string& series) {
    if (fs::is_directory(path)) return write_series(series_files(path, series));
    const std::string ending = lower_case(path.extension().string());
    if (ending == ".nrrd" || ending == ".nhdr") return write_file(path, *itk::NrrdImageIO::New());
    if (ending == ".mha" || ending == ".mhd") return write_file(path, *itk::MetaImageIO::New());
    const auto dicom = itk::GDCMImageIO::New();
    if (!dicom->CanReadFile(path.c_str())) fail("not a volume this program reads (.nrrd .nhdr .mha .mhd .nii .nii.gz, DICOM)");
    write_series({path.string()});
}

std::string one_line(std::string text) {
    for (char& c : text) c = static_cast<unsigned char>(c) < ' ' ? ' ' : c;
    const size_t first = text.find_first_not_of(' ');
    return first == std::string::npos ? "ITK gives no reason" : text.substr(first, text.find_last_not_of(' ') - first + 1);
}

}  // namespace
}  // namespace trocar

int main(int argc, char** argv) {
    if (argc < 2) {
        std::fprintf(stderr, "usage: trocar-volume-reader FILE-OR-FOLDER [SERIES] > STREAM\n");
        return 1;
    }
    itk::Object::GlobalWarningDisplayOff();
    try {
        trocar::write_volume(argv[1], argc > 2 ? argv[2] : "");
        return std::fflush(stdout) == 0 ? 0 : 1;
    } catch (const std::bad_alloc&) {
        return trocar::kChildOutOfMemory;
    } catch (const itk::MemoryAllocationError&) {
        return trocar::kChildOutOfMemory;
    } catch (const itk::ExceptionObject& e) {
        // ITK's messages start with the reporting object: "ITK ERROR: NrrdImageIO(0x55..): reason"
        std::string reason = e.GetDescription();
        const size_t object = reason.find("): ");
        const bool named = reason.rfind("ITK ERROR", 0) == 0 || reason.rfind("itk::ERROR", 0) == 0;
        if (named && object != std::string::npos) reason.erase(0, object + 3);
        const size_t cause = reason.rfind("[nrrd] ");  // the innermost of several causes
        if (cause != std::string::npos) reason.erase(0, cause + 7);
        std::fprintf(stderr, "\n%s\n", trocar::one_line(reason).c_str());
    } catch (const std::exception& e) {
        std::fprintf(stderr, "\n%s\n", trocar::one_line(e.what()).c_str());
    }
    return 1;
}
