#pragma once
#include <cstdint>
#include <string>
#include <vector>
namespace trocar::mutate {

// A small sound file of some format, to be damaged.
struct Seed {
    std::string name;  // with the ending of its format
    std::string bytes;
};

// One for each reader and dialect, made here: hand-written scenes, and what save_mesh writes.
std::vector<Seed> make_seeds();

// Mutant number `number` of a run: a seed with one to eight random edits (flipped bits, other bytes, cuts, pieces moved
// or taken from another seed, numbers and words replaced or doubled, binary numbers overwritten). The same bytes for
// the same seeds and number.
Seed make_mutant(const std::vector<Seed>& seeds, uint64_t number);

// What became of one: read and sound, or refused with an InputError. Anything else ends the process: the result is
// checked (corners, finiteness, rows), cleaned, judged and repaired.
enum class Fate { kRead, kRefused };
Fate try_mutant(const Seed& mutant);

}  // namespace trocar::mutate
