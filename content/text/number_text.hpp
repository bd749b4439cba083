#pragma once
namespace trocar {

// Parses the decimal number at the start of [at, end), with an optional sign, to the nearest double. Returns
// the end of the number, or nullptr if there is no digit. Overflow gives infinity, underflow zero.
const char* parse_number(const char* at, const char* end, double& value);

}  // namespace trocar
