#pragma once
#include "bench/table.hpp"
namespace trocar::bench {

// Heaps of `stress_pile` beside Bullet, where it is installed, and the engines whose copies lie in the folder report.peers():
// JoltPhysics and box3d, each with its headers and its static library, built with -fPIC.
void pile_rows(Report& report);

}  // namespace trocar::bench
