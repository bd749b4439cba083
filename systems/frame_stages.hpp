#pragma once
#include "systems/frame_state.hpp"

// What the rows of the frame table (frame.cpp) call: each hands the columns of the world and its scratch to one system.
namespace trocar::stages {

// Who moves by itself, comes, goes, is cut, or lies still.
void device_input(FrameState& frame);
void nodes(FrameState& frame);
void rigid_motion(FrameState& frame);
void link(FrameState& frame);
void tear(FrameState& frame);
void come_and_go(FrameState& frame);
void sleep(FrameState& frame);

// From boxes to contact rows, islands and what the haptic thread is told.
void body_boxes(FrameState& frame);
void candidate_pairs(FrameState& frame);
void refit(FrameState& frame);
void rasterise_bodies(FrameState& frame);
void candidate_cells(FrameState& frame);
void contours(FrameState& frame);
void overlap(FrameState& frame);
void edge_pass(FrameState& frame);
void penetration(FrameState& frame);
void face_pass(FrameState& frame);
void deep_overlap(FrameState& frame);
void regions(FrameState& frame);
void contact_rows(FrameState& frame);
void islands(FrameState& frame);
void local_contact(FrameState& frame);

// From one pass to the next.
void advance(FrameState& frame);

// For a picture.
void surface_normals(FrameState& frame);
void energy(FrameState& frame);
void picture(FrameState& frame);

}  // namespace trocar::stages
