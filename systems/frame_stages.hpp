#pragma once
#include "systems/frame_state.hpp"

// What the rows of the frame table (frame.cpp) call: each hands the columns of the world and its scratch to one system.
namespace trocar::stages {

// What moves by itself, comes, goes, or is cut.
void device_input(FrameState& frame);
void nodes(FrameState& frame);
void rigid_motion(FrameState& frame);
void bodies_come_and_go(FrameState& frame);
void link(FrameState& frame);
void tear(FrameState& frame);
void torn_springs(FrameState& frame);

// From boxes to contact rows and islands.
void body_boxes(FrameState& frame);
void fast_bodies(FrameState& frame);
void joined_bodies(FrameState& frame);
void excluded_pairs(FrameState& frame);
void box_pairs(FrameState& frame);
void candidate_pairs(FrameState& frame);
void sleep(FrameState& frame);
void refit(FrameState& frame);
void impact_times(FrameState& frame);
void rasterise_bodies(FrameState& frame);
void candidate_cells(FrameState& frame);
void parted_triangles(FrameState& frame);
void contours(FrameState& frame);
void overlap(FrameState& frame);
void edge_pass(FrameState& frame);
void memory_order(FrameState& frame);
void kept_edges(FrameState& frame);
void face_pass(FrameState& frame);
void penetration(FrameState& frame);
void deep_overlap(FrameState& frame);
void regions(FrameState& frame);
void contact_rows(FrameState& frame);
void edge_rows(FrameState& frame);
void loaded_rows(FrameState& frame);
void idle_rows(FrameState& frame);
void implied_rows(FrameState& frame);
void warm_start(FrameState& frame);
void islands(FrameState& frame);

// What the haptic thread is told.
void local_contact(FrameState& frame);
void haptic_surfaces(FrameState& frame);
void drive_yield(FrameState& frame);
void tissue_give(FrameState& frame);
void contact_hook(FrameState& frame);

// From one pass to the next.
void holding_groups(FrameState& frame);
void advance(FrameState& frame);
void contact_memory(FrameState& frame);
void link_forces(FrameState& frame);
void hand_forces(FrameState& frame);

// For a picture.
void surface_normals(FrameState& frame);
void energy(FrameState& frame);
void picture(FrameState& frame);

}  // namespace trocar::stages
