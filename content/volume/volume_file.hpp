#pragma once
#include <filesystem>
#include <string>

#include "content/volume/volume_stream.hpp"
namespace trocar {

struct VolumeOptions {
    std::string series{};  // UID of a DICOM series if there are several; empty = the only one
    std::string frame{};   // of NIfTI: "sform" or "qform"; empty = the first of them that is set
};

// Reads NIfTI (nifti_file.hpp); and NRRD (.nrrd .nhdr) with the segments of its header, MetaImage (.mha .mhd), a DICOM file or
// a folder with DICOM slices, through ITK in the helper program trocar-volume-reader, with limits on time and memory. Throws
// InputError "file: reason".
Volume read_volume(const std::filesystem::path& path, const VolumeOptions& options = {});

}  // namespace trocar
