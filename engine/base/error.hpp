#pragma once
#include <stdexcept>
#include <string>
namespace trocar {

// Invalid external input: a file, a scene, an argument. what() is one line with the location and the reason.
struct InputError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

}  // namespace trocar
