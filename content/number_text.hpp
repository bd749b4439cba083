#pragma once
namespace trocar {

// Reads the decimal number at the front of [at, end), with an optional sign, to the nearest double. Returns where it
// ends, or nullptr when there is no digit. Too large a number becomes infinity, too small a one zero.
const char* parse_number(const char* at, const char* end, double& value);

}  // namespace trocar
