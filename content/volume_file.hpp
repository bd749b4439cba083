#pragma once
#include <filesystem>
#include <string>

#include "content/volume_stream.hpp"
namespace trocar {

// Reads NRRD (.nrrd .nhdr), MetaImage (.mha .mhd), NIfTI (.nii .nii.gz), a DICOM file or a folder of the DICOM slices of
// one series, through ITK in the helper program trocar-volume-reader, within limits of time and memory. `series` is the
// DICOM series UID to take where a folder holds several; empty = the only one. Throws InputError "file: reason".
Volume read_volume(const std::filesystem::path& path, const std::string& series = {});

}  // namespace trocar
