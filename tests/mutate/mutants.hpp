#pragma once
#include <cstdint>
#include <string>
#include <vector>
namespace trocar::mutate {

// A small valid file of some format, to be damaged.
struct Seed {
    std::string name;  // with the extension of its format
    std::string bytes;
};

// One for each reader and dialect, generated here: hand-written scenes, and outputs of save_mesh.
std::vector<Seed> make_seeds();

// The same for inputs that control a run: scenes, sweeps, traces and recordings of hands, packets and
// messages of devices.
std::vector<Seed> make_input_seeds();

// Mutant number `number` of a run: a seed with one to eight random edits (flipped bits, replaced bytes,
// truncation, pieces moved or taken from another seed, numbers and words replaced or duplicated, binary
// numbers overwritten). Deterministic for the same seeds and number.
Seed make_mutant(const std::vector<Seed>& seeds, uint64_t number);

// Result for one mutant: read and valid, or rejected with an InputError. Anything else ends the process:
// meshes are checked (corners, finiteness, array sizes), cleaned, judged and repaired; scenes are built;
// device states must be finite.
enum class Fate { kRead, kRefused };
Fate try_mutant(const Seed& mutant);

// Whether a seed is one of make_input_seeds; used by try_mutant.
bool is_input(const Seed& seed);
Fate try_input(const Seed& mutant);

}  // namespace trocar::mutate
