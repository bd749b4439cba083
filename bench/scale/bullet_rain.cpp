// Bullet 3.24 (libbullet-dev), single precision: reference for whole scenes of soft bodies.
#include "bench/scale/bullet.hpp"
#include "bench/scale/scale.hpp"
namespace trocar::bench {

#ifdef TROCAR_WITH_BULLET
namespace {

btVector3 to_bullet(const Vec3d& v) { return {btScalar(v.x()), btScalar(v.y()), btScalar(v.z())}; }

struct Rain {
    btSoftBodyRigidBodyCollisionConfiguration configuration;
    btCollisionDispatcher dispatcher{&configuration};
    btDbvtBroadphase broadphase;
    btSequentialImpulseConstraintSolver solver;
    btSoftRigidDynamicsWorld world{&dispatcher, &broadphase, &solver, &configuration};
    std::vector<std::unique_ptr<btSoftBody>> soft;
    std::vector<std::unique_ptr<btCollisionShape>> shape;
    std::vector<std::unique_ptr<btRigidBody>> rigid;

    ~Rain() {
        for (const auto& body : soft) world.removeSoftBody(body.get());
        for (const auto& body : rigid) world.removeRigidBody(body.get());
    }
    void add_soft(const World& w, uint32_t body) {
        const MeshView view = mesh_view(w.meshes, w.bodies.mesh[body]);
        std::vector<btVector3> position;
        std::vector<btScalar> mass;
        for (uint32_t v = 0; v < view.position.size(); ++v) {
            position.push_back(to_bullet(vertex_position(surfaces_of(w), body, v)));
            mass.push_back(btScalar(1 / w.particles.offset[w.bodies.particles[body].first + v].w));
        }
        auto made = std::make_unique<btSoftBody>(&world.getWorldInfo(), int(position.size()), position.data(), mass.data());
        const MeshInfo& info = w.meshes.info[w.bodies.mesh[body]];
        for (uint32_t e = 0; e < info.edges.count; ++e) {
            const auto& edge = w.meshes.edge[info.edges.first + e];
            made->appendLink(int(edge[0]), int(edge[1]));
        }
        for (const Triangle& t : view.triangle) made->appendFace(int(t[0]), int(t[1]), int(t[2]));
        made->m_cfg.collisions = btSoftBody::fCollision::VF_SS | btSoftBody::fCollision::SDF_RS;
        made->m_cfg.piterations = 4;
        made->m_cfg.kMT = btScalar(0.2);
        made->m_cfg.kDF = btScalar(0.3);
        made->m_materials[0]->m_kLST = btScalar(0.5);
        made->setPose(false, true);
        made->getCollisionShape()->setMargin(btScalar(2e-3));
        world.addSoftBody(made.get());
        soft.push_back(std::move(made));
    }
    void add_box(const World& w, uint32_t body) {
        const Box& box = w.meshes.info[w.bodies.mesh[body]].box;
        shape.push_back(std::make_unique<btBoxShape>(to_bullet(0.5 * (box.max - box.min))));
        shape.back()->setMargin(btScalar(2e-3));
        const Quat& q = w.poses.orientation[body];
        const btQuaternion turn(btScalar(q.x), btScalar(q.y), btScalar(q.z), btScalar(q.w));
        btRigidBody::btRigidBodyConstructionInfo info(0, nullptr, shape.back().get());
        info.m_startWorldTransform = btTransform(turn, to_bullet(w.poses.origin[body]));
        rigid.push_back(std::make_unique<btRigidBody>(info));
        world.addRigidBody(rigid.back().get());
    }
};

}  // namespace

BulletWorld bullet_world(const World& w) {
    auto rain = std::make_shared<Rain>();
    const btVector3 gravity = to_bullet(w.settings.gravity);
    rain->world.setGravity(gravity);
    btSoftBodyWorldInfo& info = rain->world.getWorldInfo();
    info.m_gravity = gravity;
    info.m_dispatcher = &rain->dispatcher;
    info.m_broadphase = &rain->broadphase;
    info.m_sparsesdf.Initialize();
    for (uint32_t body = 0; body < w.bodies.mesh.size(); ++body) {
        if (w.bodies.motion[body] == Motion::kDeformable)
            rain->add_soft(w, body);
        else
            rain->add_box(w, body);
    }
    return {[rain] {
                rain->world.stepSimulation(btScalar(1.0 / 60), 0);
                rain->world.getWorldInfo().m_sparsesdf.GarbageCollect();
            },
            [rain] {
                double low = 1e30;
                for (const auto& body : rain->soft)
                    for (int i = 0; i < body->m_nodes.size(); ++i) low = std::min(low, double(body->m_nodes[i].m_x.z()));
                return low;
            }};
}
#else
BulletWorld bullet_world(const World&) { return {}; }
#endif

}  // namespace trocar::bench
