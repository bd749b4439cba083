#pragma once
#include <filesystem>
#include <string>

#include "content/volume/volume_stream.hpp"
namespace trocar {

// Reads NRRD (.nrrd .nhdr), MetaImage (.mha .mhd), NIfTI (.nii .nii.gz), a DICOM file or a folder with DICOM
// slices, through ITK in the helper program trocar-volume-reader, with limits on time and memory. `series`
// selects a DICOM series UID if there are several; empty = the only one. Throws InputError "file: reason".
Volume read_volume(const std::filesystem::path& path, const std::string& series = {});

}  // namespace trocar
