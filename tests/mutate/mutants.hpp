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

// The same for what steers a run: scenes, sweeps, traces and recordings of hands, packets and messages of devices.
std::vector<Seed> make_input_seeds();

// Mutant number `number` of a run: a seed with one to eight random edits (flipped bits, other bytes, cuts, pieces moved
// or taken from another seed, numbers and words replaced or doubled, binary numbers overwritten). The same bytes for
// the same seeds and number.
Seed make_mutant(const std::vector<Seed>& seeds, uint64_t number);

// What became of one: read and sound, or refused with an InputError. Anything else ends the process: meshes are checked
// (corners, finiteness, rows), cleaned, judged and repaired; scenes are built; states of devices must be finite.
enum class Fate { kRead, kRefused };
Fate try_mutant(const Seed& mutant);

// Of those of make_input_seeds; try_mutant asks.
bool is_input(const Seed& seed);
Fate try_input(const Seed& mutant);

}  // namespace trocar::mutate
