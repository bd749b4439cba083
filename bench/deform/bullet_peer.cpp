// Bullet 3.24 (libbullet-dev), single precision: reference for the spring bodies.
#include "bench/deform/deform.hpp"
#include "bench/scale/bullet.hpp"
namespace trocar::bench {

#ifdef TROCAR_WITH_BULLET
namespace {

// Parts common to both kinds of world; the functions that use it keep it alive.
struct Common {
    btSoftBodyRigidBodyCollisionConfiguration configuration;
    btCollisionDispatcher dispatcher{&configuration};
    btDbvtBroadphase broadphase;
    std::unique_ptr<btSoftBody> body;

    void make_body(btSoftBodyWorldInfo& info, const SpringGraph& graph) {
        info.m_gravity = btVector3(0, 0, btScalar(-9.81));
        info.m_dispatcher = &dispatcher;
        info.m_broadphase = &broadphase;
        std::vector<btVector3> position;
        std::vector<btScalar> mass;
        for (size_t i = 0; i < graph.position.size(); ++i) {
            const Vec3d& p = graph.position[i];
            position.emplace_back(btScalar(p.x()), btScalar(p.y()), btScalar(p.z()));
            mass.push_back(btScalar(graph.mass[i]));
        }
        body = std::make_unique<btSoftBody>(&info, int(position.size()), position.data(), mass.data());
        for (const auto& [i, j] : graph.edge) body->appendLink(int(i), int(j), nullptr, false);
        body->m_cfg.collisions = 0;
        body->getCollisionShape()->setMargin(btScalar(1e-4));
    }
    std::vector<Vec3d> positions() const {
        std::vector<Vec3d> out;
        for (int i = 0; i < body->m_nodes.size(); ++i) {
            const btVector3& p = body->m_nodes[i].m_x;
            out.emplace_back(p.x(), p.y(), p.z());
        }
        return out;
    }
};

struct LinkWorld : Common {
    btSequentialImpulseConstraintSolver solver;
    btSoftRigidDynamicsWorld world{&dispatcher, &broadphase, &solver, &configuration};
    ~LinkWorld() { world.removeSoftBody(body.get()); }
};

struct DeformableWorld : Common {
    btDeformableBodySolver body_solver;
    btDeformableMultiBodyConstraintSolver solver;
    std::unique_ptr<btDeformableMultiBodyDynamicsWorld> world;
    std::unique_ptr<btDeformableMassSpringForce> springs;
    std::unique_ptr<btDeformableGravityForce> gravity;
    ~DeformableWorld() {
        world->removeForce(body.get(), springs.get());
        world->removeForce(body.get(), gravity.get());
        world->removeSoftBody(body.get());
    }
};

}  // namespace

bool have_bullet() { return true; }
BulletBody bullet_links(const SpringGraph& graph, int iterations) {
    auto w = std::make_shared<LinkWorld>();
    w->world.setGravity(btVector3(0, 0, btScalar(-9.81)));
    w->make_body(w->world.getWorldInfo(), graph);
    w->body->m_cfg.piterations = iterations;
    w->body->m_materials[0]->m_kLST = btScalar(0.5);
    w->body->updateConstants();
    w->world.addSoftBody(w->body.get());
    return {[w] { w->world.stepSimulation(btScalar(1e-3), 0); }, [w] { return w->positions(); }};
}

BulletDeformable bullet_deformable(const SpringGraph& graph, double dt, double damping) {
    auto w = std::make_shared<DeformableWorld>();
    w->solver.setDeformableSolver(&w->body_solver);
    w->world = std::make_unique<btDeformableMultiBodyDynamicsWorld>(&w->dispatcher, &w->broadphase, &w->solver, &w->configuration,
                                                                    &w->body_solver);
    w->world->setImplicit(true);
    w->world->setLineSearch(false);
    w->make_body(w->world->getWorldInfo(), graph);
    w->body->m_sleepingThreshold = 0;
    w->body->m_cfg.drag = 0;
    w->body->setDampingCoefficient(btScalar(damping * dt));
    w->world->addSoftBody(w->body.get());
    w->springs = std::make_unique<btDeformableMassSpringForce>(btScalar(graph.stiffness), btScalar(0), false);
    w->gravity = std::make_unique<btDeformableGravityForce>(btVector3(0, 0, 0));
    w->world->addForce(w->body.get(), w->springs.get());
    w->world->addForce(w->body.get(), w->gravity.get());
    BulletDeformable b;
    b.step = [w, dt] { w->world->stepSimulation(btScalar(dt), 0); };
    b.positions = [w] { return w->positions(); };
    b.set_gravity = [w](double g) { w->gravity->m_gravity = btVector3(0, 0, btScalar(g)); };
    return b;
}
#else
bool have_bullet() { return false; }
BulletBody bullet_links(const SpringGraph&, int) { return {}; }
BulletDeformable bullet_deformable(const SpringGraph&, double, double) { return {}; }
#endif

}  // namespace trocar::bench
