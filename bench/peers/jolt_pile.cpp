// Adapter to Jolt Physics, compiled by `trocar_bench scale pile --peers DIR` from DIR/JoltPhysics.
// clang-format off: this header comes before all others of Jolt
#include <Jolt/Jolt.h>
// clang-format on
#include <Jolt/Core/Factory.h>
#include <Jolt/Core/JobSystemSingleThreaded.h>
#include <Jolt/Core/TempAllocator.h>
#include <Jolt/Physics/Body/BodyCreationSettings.h>
#include <Jolt/Physics/Collision/BroadPhase/BroadPhaseLayerInterfaceTable.h>
#include <Jolt/Physics/Collision/BroadPhase/ObjectVsBroadPhaseLayerFilterTable.h>
#include <Jolt/Physics/Collision/ObjectLayerPairFilterTable.h>
#include <Jolt/Physics/Collision/Shape/BoxShape.h>
#include <Jolt/Physics/PhysicsSystem.h>
#include <Jolt/RegisterTypes.h>

#include <memory>
#include <vector>

#include "bench/peers/pile_engine.hpp"
namespace {

constexpr JPH::ObjectLayer kFixed = 0, kFree = 1;
constexpr uint32_t kSubsteps = 4;

// Jolt's allocator and types must be there before any of its objects.
struct Library {
    Library() {
        JPH::RegisterDefaultAllocator();
        JPH::Factory::sInstance = new JPH::Factory();
        JPH::RegisterTypes();
    }
};

struct Pile {
    JPH::BroadPhaseLayerInterfaceTable layers{2, 2};
    JPH::ObjectLayerPairFilterTable pairs{2};
    std::unique_ptr<JPH::ObjectVsBroadPhaseLayerFilterTable> broad;  // of the filled tables
    JPH::TempAllocatorImpl scratch{64 << 20};
    JPH::JobSystemSingleThreaded jobs{JPH::cMaxPhysicsJobs};
    JPH::PhysicsSystem system;
    std::vector<JPH::BodyID> body;
    float step = 0;
    int substeps = 0;
};

JPH::Vec3 vec(const double* v) { return {float(v[0]), float(v[1]), float(v[2])}; }

void* make(const PileBox* box, uint32_t count, const PileSettings* settings) {
    static const Library library;
    auto* pile = new Pile;
    pile->step = float(settings->step);
    pile->substeps = int(settings->substeps);
    pile->layers.MapObjectToBroadPhaseLayer(kFixed, JPH::BroadPhaseLayer(0));
    pile->layers.MapObjectToBroadPhaseLayer(kFree, JPH::BroadPhaseLayer(1));
    pile->pairs.EnableCollision(kFixed, kFree);
    pile->pairs.EnableCollision(kFree, kFree);
    pile->broad = std::make_unique<JPH::ObjectVsBroadPhaseLayerFilterTable>(pile->layers, 2, pile->pairs, 2);
    pile->system.Init(count, 0, 64 * count, 64 * count, pile->layers, *pile->broad, pile->pairs);
    pile->system.SetGravity(vec(settings->gravity));
    JPH::PhysicsSettings physics;
    physics.mPenetrationSlop = 5e-4f;  // m; of 20 mm boxes of 100 mm would keep a fifth of overlap
    pile->system.SetPhysicsSettings(physics);
    for (uint32_t i = 0; i < count; ++i) {
        const double* q = box[i].orientation;
        JPH::BodyCreationSettings body(new JPH::BoxShape(vec(box[i].half), 5e-4f), JPH::RVec3(vec(box[i].position)),
                                       JPH::Quat(float(q[0]), float(q[1]), float(q[2]), float(q[3])).Normalized(),
                                       box[i].free ? JPH::EMotionType::Dynamic : JPH::EMotionType::Static, box[i].free ? kFree : kFixed);
        body.mFriction = float(settings->friction);
        body.mLinearDamping = body.mAngularDamping = 0;
        body.mOverrideMassProperties = JPH::EOverrideMassProperties::CalculateMassAndInertia;
        auto* shape = static_cast<JPH::BoxShape*>(const_cast<JPH::Shape*>(body.GetShape()));
        shape->SetDensity(float(settings->density));
        pile->body.push_back(pile->system.GetBodyInterface().CreateAndAddBody(body, JPH::EActivation::Activate));
    }
    pile->system.OptimizeBroadPhase();
    return pile;
}

void step(void* handle) {
    auto* pile = static_cast<Pile*>(handle);
    pile->system.Update(pile->step, pile->substeps, &pile->scratch, &pile->jobs);
}

void poses(void* handle, double* pose) {
    const auto* pile = static_cast<const Pile*>(handle);
    for (const JPH::BodyID id : pile->body) {
        JPH::RVec3 at;
        JPH::Quat turn;
        pile->system.GetBodyInterfaceNoLock().GetPositionAndRotation(id, at, turn);
        for (const double x : {double(at.GetX()), double(at.GetY()), double(at.GetZ()), double(turn.GetX()), double(turn.GetY()),
                               double(turn.GetZ()), double(turn.GetW())})
            *pose++ = x;
    }
}

void destroy(void* pile) { delete static_cast<Pile*>(pile); }

}  // namespace

PileEngine pile_engine() { return {"slop and convex radius 0.5 mm, one thread", kSubsteps, make, step, poses, destroy}; }
