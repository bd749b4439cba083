// Adapter to Box3D, compiled by `trocar_bench scale pile --peers DIR` from DIR/box3d.
#include <box3d/box3d.h>

#include <vector>

#include "bench/peers/pile_engine.hpp"
namespace {

constexpr uint32_t kSubsteps = 8;

struct Pile {
    b3WorldId world;
    std::vector<b3BodyId> body;
    float step = 0;
    int substeps = 0;
};

void* make(const PileBox* box, uint32_t count, const PileSettings* settings) {
    b3SetLengthUnitsPerMeter(0.1f);  // its slop, 5 mm of boxes of a metre, scales with it
    auto* pile = new Pile;
    pile->step = float(settings->step);
    pile->substeps = int(settings->substeps);
    b3WorldDef world = b3DefaultWorldDef();
    world.gravity = {float(settings->gravity[0]), float(settings->gravity[1]), float(settings->gravity[2])};
    world.workerCount = 1;
    pile->world = b3CreateWorld(&world);
    for (uint32_t i = 0; i < count; ++i) {
        const double *p = box[i].position, *q = box[i].orientation, *half = box[i].half;
        b3BodyDef body = b3DefaultBodyDef();
        body.type = box[i].free ? b3_dynamicBody : b3_staticBody;
        body.position = {float(p[0]), float(p[1]), float(p[2])};
        body.rotation = {{float(q[0]), float(q[1]), float(q[2])}, float(q[3])};
        pile->body.push_back(b3CreateBody(pile->world, &body));
        b3ShapeDef shape = b3DefaultShapeDef();
        shape.density = float(settings->density);
        shape.baseMaterial.friction = float(settings->friction);
        const b3BoxHull hull = b3MakeBoxHull(float(half[0]), float(half[1]), float(half[2]));
        b3CreateHullShape(pile->body.back(), &shape, &hull.base);
    }
    return pile;
}

void step(void* handle) {
    auto* pile = static_cast<Pile*>(handle);
    b3World_Step(pile->world, pile->step, pile->substeps);
}

void poses(void* handle, double* pose) {
    for (const b3BodyId body : static_cast<Pile*>(handle)->body) {
        const auto at = b3Body_GetPosition(body);
        const b3Quat turn = b3Body_GetRotation(body);
        for (const double x :
             {double(at.x), double(at.y), double(at.z), double(turn.v.x), double(turn.v.y), double(turn.v.z), double(turn.s)})
            *pose++ = x;
    }
}

void destroy(void* handle) {
    auto* pile = static_cast<Pile*>(handle);
    b3DestroyWorld(pile->world);
    delete pile;
}

}  // namespace

PileEngine pile_engine() { return {"length unit 0.1 m, one worker", kSubsteps, make, step, poses, destroy}; }
