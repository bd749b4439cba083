#pragma once
#include <stdexcept>
#include <string>
namespace trocar {

// Bad input from outside: a file, a scene, an argument. what() is one line that names the place and the reason.
struct InputError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

}  // namespace trocar
