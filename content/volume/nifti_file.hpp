#pragma once
#include <filesystem>
#include <string>

#include "content/volume/volume.hpp"
namespace trocar {

// Whether a name ends in .nii or .nii.gz.
bool is_nifti_name(const std::filesystem::path& path);

// Reads a NIfTI-1 or NIfTI-2 file of three dimensions, of either byte order, packed or not (nifti1.h, nifti2.h). Metres
// and micrometres become millimetres. Voxels lie where the sform says if its code is above 0 (method 3), else where the
// qform says (method 2), else at multiples of the voxel size (method 1); `frame` = "sform" or "qform" chooses, "" = by that
// rule. Warns of two frames that differ, of a voxel size of 0, of bytes beyond the voxels. Values are scaled to
// doubles if the header says so. Throws InputError "file: reason".
Volume read_nifti(const std::filesystem::path& path, const std::string& frame);

}  // namespace trocar
