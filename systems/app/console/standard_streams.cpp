#include "systems/app/console/standard_streams.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>

#include "engine/base/error.hpp"
namespace trocar {

void write_standard_output(std::string_view text) {
    if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size() || std::fflush(stdout) != 0)
        throw InputError(std::string("standard output: ") + std::strerror(errno));
}

std::string read_standard_input() {
    std::string text;
    char block[65536];
    for (size_t n; (n = std::fread(block, 1, sizeof block, stdin)) > 0;) text.append(block, n);
    if (std::ferror(stdin)) throw InputError(std::string("standard input: ") + std::strerror(errno));
    return text;
}

}  // namespace trocar
