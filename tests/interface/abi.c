/* Prints the sizes of the structs of trocar.h, and where their last members lie, as a C compiler has them. */
#include <stddef.h>
#include <stdio.h>
#include <trocar/trocar.h>

#define STRUCT(name, last) printf("struct " #name " %zu " #last " %zu\n", sizeof(name), offsetof(name, last))

int main(void) {
    STRUCT(trocar_scene, reserved);
    STRUCT(trocar_view, unit);
    STRUCT(trocar_body, mass);
    STRUCT(trocar_nearest, reserved);
    STRUCT(trocar_target, seconds);
    STRUCT(trocar_tool, grip_torque);
    STRUCT(trocar_contact, distance);
    STRUCT(trocar_pair, reserved);
    STRUCT(trocar_link, largest_strain);
    STRUCT(trocar_staple, break_strain);
    STRUCT(trocar_picture, field_of_view);
    STRUCT(trocar_mesh, corners);
    STRUCT(trocar_collider_options, tolerance);
    STRUCT(trocar_region, direction);
    return 0;
}
