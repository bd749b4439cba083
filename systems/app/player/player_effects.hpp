#pragma once
#include "systems/frame/frame.hpp"
#include "systems/output/picture_snapshot.hpp"
namespace trocar {

// Codes what the player shows besides bodies: threads and staples as lines with a radius, drops and knots as balls, smoke, the liquid on
// surfaces and coagulated tissue. All of one moment, not as steps from the one before.
class PlayerEffects {
 public:
    static constexpr double kFilmStep = 1e-6;  // m, of the thickness of liquid: less does not show (blood takes 5 % of the green light)
    static constexpr double kRiseStep = 1e-5;  // m, of the height of its surface

    // Whether there can be any in a scene; without, nothing is coded.
    static bool are_in(const World& world);
    // Appends them as readEffects of page/data.js reads them. `point_step`: m, of places, which are relative to `origin`.
    void put(std::vector<uint8_t>& out, const World& world, const Vec3d& origin, double point_step);
    const Vec3d& up() const { return effects_.up; }  // unit, world, against gravity as liquid has it, when put() was called last

 private:
    PictureLiquidScratch scratch_;
    PictureSnapshot effects_;
};

}  // namespace trocar
