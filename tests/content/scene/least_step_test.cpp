#include <gtest/gtest.h>

#include <string>

#include "tests/frame/written_scene.hpp"

namespace trocar {
namespace {

// Materials within their admitted ranges, together too stiff and light for any explicit step: refused by name, where the number of
// steps of a pass overflowed. Implicit steps take shells of them.
TEST(LeastStep, TooStiffAndLightIsRefused) {
    const auto ball = [](const std::string& modulus, const std::string& density, const std::string& model) {
        return "[[body]]\nname = \"ball\"\nshape = \"sphere\"\nsize = 0.002\ntriangles = 300\nmotion = \"deformable\"\n" + model +
               "[body.tissue]\nyoungs_modulus = " + modulus + "\ndensity = " + density + "\n";
    };
    for (const std::string& model : {std::string(), std::string("model = \"solid\"\ncells = 6\n")}) {
        for (const auto& [modulus, density] : {std::pair("1e12", "1e-3"), std::pair("1e12", "1e-2"), std::pair("3e11", "1e-3")}) {
            const std::string error = WrittenScene("stiff", ball(modulus, density, model)).error();
            EXPECT_NE(error.find("body \"ball\": its explicit step would be "), std::string::npos) << error << model << modulus;
            if (model.empty()) {
                EXPECT_EQ(WrittenScene("stiff", ball(modulus, density, "integrator = \"implicit\"\n")).error(), "");
            }
        }
        EXPECT_EQ(WrittenScene("stiff", ball("1e9", "1000", model)).error(), "") << model;
    }
}

}  // namespace
}  // namespace trocar
