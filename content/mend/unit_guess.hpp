#pragma once
#include <string>
namespace trocar {

// The most likely length unit of a file by size: organs and instruments have diagonals of 12 mm to 3 m.
struct UnitGuess {
    const char* unit = "m";  // "m", "cm", "mm" or "um"
    double metres = 1;       // metres per unit
    std::string rule;        // the rule that applied, with the diagonal
};

// Diagonal up to 3: metres; up to 12: centimetres (an organ of 12 mm is rarer than one of 12 cm); up to 3000:
// millimetres; above: micrometres.
UnitGuess guess_unit(double diagonal);

}  // namespace trocar
