#pragma once
#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "reference/paths.hpp"
namespace trocar {

struct Outcome {
    int code = -1;  // exit code; -1 for a signal
    std::string out, err;
};

// Runs the program in a folder; the shell splits the arguments. `scratch` receives a file with standard
// error.
inline Outcome run_program(const std::string& arguments, const std::filesystem::path& working, const std::filesystem::path& scratch) {
    const std::filesystem::path err = scratch / "stderr.txt";
    const std::string command = "cd " + working.string() + " && " + program_path().string() + " " + arguments + " 2>" + err.string();
    Outcome outcome;
    FILE* pipe = popen(command.c_str(), "r");
    std::array<char, 4096> block;
    for (size_t n; (n = fread(block.data(), 1, block.size(), pipe)) > 0;) outcome.out.append(block.data(), n);
    const int status = pclose(pipe);
    outcome.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    std::stringstream text;
    text << std::ifstream(err).rdbuf();
    outcome.err = text.str();
    return outcome;
}

}  // namespace trocar
