#pragma once
#include <string>
namespace trocar {

// The unit a file most likely counts in, by its size alone: what this program simulates, organs and instruments, is
// between 12 mm and 3 m from corner to corner of its box.
struct UnitGuess {
    const char* unit = "m";  // "m", "cm", "mm" or "um"
    double metres = 1;       // of one unit
    std::string rule;        // the rule that decided, with the diagonal
};

// A diagonal up to 3 is one in metres, up to 12 in centimetres (an organ of 12 mm is rarer than one of 12 cm), up to
// 3000 in millimetres, above in micrometres.
UnitGuess guess_unit(double diagonal);

}  // namespace trocar
