#include "content/mend/unit_guess.hpp"

#include <cstdio>
namespace trocar {

UnitGuess guess_unit(double diagonal) {
    UnitGuess guess;
    if (diagonal > 3000) {
        guess = {"um", 1e-6, ""};
    } else if (diagonal > 12) {
        guess = {"mm", 1e-3, ""};
    } else if (diagonal > 3) {
        guess = {"cm", 1e-2, ""};
    }
    char text[96];
    std::snprintf(text, sizeof text, "diagonal %.4g: m up to 3, cm up to 12, mm up to 3000, um above", diagonal);
    guess.rule = text;
    return guess;
}

}  // namespace trocar
