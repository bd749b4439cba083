/* Trocar from C, twice: a scene with a soft ball that falls on a table, and the contact of two meshes without a world.
 *
 *     cc -std=c11 docs/example.c -o example $(pkg-config --cflags --libs trocar) && ./example */
#include <stdio.h>
#include <stdlib.h>
#include <trocar/trocar.h>

static const char* const scene_text =
    "[[body]]\nname = \"table\"\nshape = \"table\"\ntriangles = 500\n"
    "[[body]]\nname = \"ball\"\nshape = \"sphere\"\ntriangles = 1000\nsize = 0.1\nmotion = \"deformable\"\n"
    "anchor = \"shape\"\nposition = [0.0, 0.0, 0.07]\ntissue = {youngs_modulus = 2e4}\n";

static void need(trocar_code code) {
    if (code == TROCAR_OK) return;
    fprintf(stderr, "%s\n", trocar_last_error());
    exit(1);
}

static void fall(void) {
    TROCAR_NEW(trocar_scene, scene);
    scene.text = scene_text;
    trocar_world* world;
    need(trocar_open(&scene, &world));
    need(trocar_step_until(world, 3.0));
    uint32_t ball;
    need(trocar_find(world, TROCAR_BODY, "ball", &ball));
    const double above[3] = {0.0, 0.0, 0.2};
    trocar_nearest nearest;
    need(trocar_distance(world, ball, above, 1, &nearest));
    printf("after %.2f s the ball's top is at z = %.3f m\n", trocar_time(world), nearest.point[2]);
    TROCAR_NEW(trocar_view, kinetic);
    need(trocar_array(world, "energy.kinetic", &kinetic));
    printf("kinetic energy below 1 mJ: %s (unit %s)\n", *(const double*)kinetic.data < 1e-3 ? "yes" : "no", kinetic.unit);
    trocar_close(world);
}

static void touch(void) {
    /* two unit tetrahedra, the second with its corner 0.1 m inside the first */
    double a[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}, b[12];
    static const uint32_t corners[12] = {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3};
    for (int i = 0; i < 12; ++i) b[i] = a[i] + (i % 3 == 2 ? 0.9 : 0.02);
    const uint32_t size = sizeof(trocar_mesh);
    const trocar_mesh meshes[2] = {{size, 4, 4, 0, a, corners}, {size, 4, 4, 0, b, corners}};
    trocar_collider* collider;
    need(trocar_collider_open(meshes, 2, NULL, &collider));
    need(trocar_collider_find(collider));
    trocar_pair pair;
    size_t count;
    need(trocar_collider_pairs(collider, &pair, 1, &count));
    printf("overlap %u, depth %.6f m along (%.3f, %.3f, %.3f)\n", pair.overlap, pair.depth, pair.direction[0], pair.direction[1],
           pair.direction[2]);
    trocar_collider_close(collider);
}

int main(void) {
    fall();
    touch();
    return 0;
}
