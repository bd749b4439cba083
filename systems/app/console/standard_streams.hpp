#pragma once
#include <string>
#include <string_view>
namespace trocar {

// Writes to standard output and flushes; throws InputError on failure (full disk, closed pipe).
void write_standard_output(std::string_view text);
std::string read_standard_input();

}  // namespace trocar
