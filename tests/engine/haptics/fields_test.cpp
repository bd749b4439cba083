#include "components/fields.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "engine/files/capture_file.hpp"
#include "engine/world/world.hpp"
namespace trocar {
namespace {

struct Inner {
    double x = 1;
    TROCAR_FIELDS(x, "m");
};
struct Whole {
    std::vector<double> mass;
    uint32_t body = 3;
    Inner inner;
    std::string cache;
    TROCAR_FIELDS(mass, "kg", body, "index of bodies", inner);
    TROCAR_OTHER_FIELDS(cache);
};
struct OneMissing {
    std::vector<double> mass;
    uint32_t body = 3;
    Inner inner;
    TROCAR_FIELDS(mass, "kg", inner);
};
struct OneTwice {
    double a = 0, b = 0;
    TROCAR_FIELDS(a, a);
};
struct OtherMissing {
    double a = 0, b = 0, cache = 0;
    TROCAR_FIELDS(a);
    TROCAR_OTHER_FIELDS(cache);
};

static_assert(lists_every_member<Inner>() && lists_every_member<Whole>() && lists_every_member<Bodies>());
static_assert(!lists_every_member<OneMissing>() && !lists_every_member<OneTwice>() && !lists_every_member<OtherMissing>());

TEST(Fields, NamesUnitsAndMembersInTheOrderOfTheList) {
    Whole whole;
    std::string text;
    each_field(whole, [&](const FieldName& field, const auto& member) {
        text += std::string(field.name) + "[" + std::string(field.unit) + "]";
        if constexpr (std::is_same_v<decltype(member), const uint32_t&>) text += std::to_string(member);
    });
    EXPECT_EQ(text, "mass[kg]body[index of bodies]3inner[]");
}

// Breaks when two resources store under one name, or one stores what it does not read back.
TEST(Fields, EveryResourceIsStoredUnderNamesOfItsOwn) {
    World world;
    CaptureRecord record{"state", {}};
    for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r) save_resource(world, static_cast<Resource>(r), record);
    std::vector<std::string> names;
    for (const CaptureArray& a : record.arrays) names.push_back(a.name);
    for (const char* name : {"settings.gravity[2]", "settings.contact.share", "springs.fans.first", "solids.corner[3]", "haptics.tool",
                             "haptics.state", "local_contact", "report.expired_constraints", "particles.velocity_x", "screened.origin[0]"})
        EXPECT_EQ(std::count(names.begin(), names.end(), name), 1) << name;
    std::sort(names.begin(), names.end());
    EXPECT_EQ(std::adjacent_find(names.begin(), names.end()), names.end());
    World again;
    strip_resources(again, 0);
    for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r) {
        load_resource(record, static_cast<Resource>(r), again);
        EXPECT_EQ(resource_hash(again, static_cast<Resource>(r)), resource_hash(world, static_cast<Resource>(r))) << r;
    }
}

// Required of external data: enums have a declared value, indices are in range, numbers are finite.
TEST(Fields, AFaultIsNamedByItsField) {
    const auto fault = [](const auto& damage) {
        World world;
        damage(world);
        return find_fault(world);
    };
    EXPECT_EQ(fault([](World&) {}), "");
    EXPECT_EQ(fault([](World& w) { w.settings.contact.share = static_cast<ResponseShare>(9); }), "settings.contact.share is of no kind");
    EXPECT_EQ(fault([](World& w) { w.haptics.surface.resize(1), w.haptics.surface[0].body = 7; }), "haptics.surface.body 7 of 0");
    EXPECT_EQ(fault([](World& w) { w.haptics.state.resize(1), w.haptics.state[0].pierce.body = 7; }), "haptics.state.pierce.body 7 of 0");
    EXPECT_EQ(fault([](World& w) { w.pools.slots.push_back({0, 2}); }), "pools.slots reach beyond their array");
    EXPECT_EQ(fault([](World& w) { w.settings.sleep_after = std::nan(""); }).substr(0, 8), "settings");
    EXPECT_EQ(fault([](World& w) { w.meshes.material.resize(1), w.paths.key.resize(1), w.paths.key[0].grip = std::nan(""); }),
              "paths.key.grip is not a number");
}

// A number of the report counts in islands as its line says.
TEST(ReportNumbers, IslandsAreMergedAsTheirLineSays) {
    Report report;
    IslandReport one, two;
    one.expired_constraints = 2, one.deepest_residual = 0.5, one.min_volume_ratio = 0.25;
    two.expired_constraints = 3, two.deepest_residual = 0.1, two.min_volume_ratio = 0.75;
    add_to_report(one, report), add_to_report(two, report);
    EXPECT_EQ(report.expired_constraints, 5u);
    EXPECT_EQ(report.deepest_residual, 0.5);
    EXPECT_EQ(report.min_volume_ratio, 0.25);
}

}  // namespace
}  // namespace trocar
