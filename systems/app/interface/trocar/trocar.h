/* Trocar in C: worlds from scenes, their arrays by name, tools, forces, distances, pictures; batches of worlds; and
 * contact of deforming meshes without a world. Link with -ltrocar. Plain C99 or C++.
 *
 * - SI units: m, kg, s, N, J, radians. Vectors are x, y, z; quaternions w, x, y, z.
 * - Every struct begins with `size`: set it to sizeof of the struct before the call (TROCAR_NEW does, and zeroes the
 *   rest). It lets a program built with an older header run with a newer library, which only appends members.
 * - A function that can fail returns a trocar_code. With anything but TROCAR_OK it changed nothing, unless it says so,
 *   and trocar_last_error() has the reason in words: for scenes with file, line and column.
 * - The caller owns every buffer. Functions that fill a list take its capacity and always tell the count there is: with a
 *   capacity that is too small they return TROCAR_TOO_SMALL and fill nothing, so 0 asks for the count.
 * - One handle belongs to one thread at a time; different handles may be used beside each other. Functions use the worker
 *   threads of the library (trocar_set_threads); results are the same to the bit for any number of them.
 * - Nothing is thrown, nothing printed, no signal handled. */
#ifndef TROCAR_TROCAR_H
#define TROCAR_TROCAR_H
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Rises when a struct or a function changes in a way that older programs cannot run with; the library's soname has it. */
#define TROCAR_ABI 0
/* "No index": no body, triangle, link. */
#define TROCAR_NONE UINT32_MAX

/* A zeroed struct with its size set: TROCAR_NEW(trocar_scene, scene); */
#ifdef __cplusplus
#define TROCAR_ZERO \
    {}
#else
#define TROCAR_ZERO \
    { 0 }
#endif
#define TROCAR_NEW(type, name) \
    type name = TROCAR_ZERO;   \
    name.size = (uint32_t)sizeof(type)

typedef enum {
    TROCAR_OK = 0,
    TROCAR_BAD_INPUT = 1, /* a scene, mesh, file or value that cannot be used */
    TROCAR_BAD_CALL = 2,  /* a null pointer, an unset size, an index or a name that is not there */
    TROCAR_TOO_SMALL = 3, /* the buffer; nothing was filled, the count needed was told */
    TROCAR_NO_MEMORY = 4,
    TROCAR_INTERNAL = 5 /* a fault of the library: please report it */
} trocar_code;

/* Why the last call of this thread failed; empty if it did not. Valid until the thread's next call. */
const char* trocar_last_error(void);
/* TROCAR_ABI of the library, and its version, "0.1.0". */
uint32_t trocar_abi(void);
const char* trocar_version(void);
/* Worker threads for all worlds of the process; 0 = all cores (as without this call). TROCAR_BAD_CALL once work began. */
trocar_code trocar_set_threads(uint32_t threads);

/* ---- worlds ------------------------------------------------------------------------------------------------- */

typedef struct trocar_world trocar_world;

/* A scene to open. Give `file` (a path, or the name of a built-in scene: "palpate") or `text` (TOML; `file` is then what
 * errors call it, and files that the text names are looked for beside it). */
typedef struct {
    uint32_t size;
    uint32_t set_count; /* of set */
    const char* file;
    const char* text;
    const char* const* set; /* overrides "key=value", as `trocar run --set`: "liver.tissue.youngs_modulus=2e4" */
    uint32_t paint;         /* 1: textures of generated shapes, which only pictures show */
    uint32_t reserved;
} trocar_scene;

/* Builds a scene. *world is for trocar_close. TROCAR_BAD_INPUT: "file:line:column: reason". */
trocar_code trocar_open(const trocar_scene* scene, trocar_world** world);
/* Frees a world; null does nothing. Its views must not be used any more. */
void trocar_close(trocar_world* world);
/* What building the scene warned of, one line each, into text (with a final 0). *length: of the whole text with its 0. */
trocar_code trocar_warnings(const trocar_world* world, char* text, size_t capacity, size_t* length);

/* Simulates `passes` contact passes: 1/60 s each, or 1/contact.rate of the scene. */
trocar_code trocar_step(trocar_world* world, uint32_t passes);
/* Passes until the clock is at `seconds` or later; none if it is. The clock counts whole milliseconds. */
trocar_code trocar_step_until(trocar_world* world, double seconds);
/* s, simulated so far. Negative for null. */
double trocar_time(const trocar_world* world);
/* Hash of the state: that of `trocar run` after as many passes. */
trocar_code trocar_hash(const trocar_world* world, uint64_t* hash);

/* The whole state (positions, velocities, contacts remembered, tools, links, energies, targets) as bytes. They can be
 * restored into any world of the same scene and overrides, in any process on a machine of the same kind. */
trocar_code trocar_save(const trocar_world* world, void* bytes, size_t capacity, size_t* length);
/* TROCAR_BAD_INPUT for bytes that are damaged or of another scene. What passes derive (contacts) is empty until the next. */
trocar_code trocar_restore(trocar_world* world, const void* bytes, size_t length);
/* Back to the state in which the world was opened. */
trocar_code trocar_reset(trocar_world* world);

/* ---- arrays ------------------------------------------------------------------------------------------------- */

typedef enum { TROCAR_U8 = 0, TROCAR_U16 = 1, TROCAR_U32 = 2, TROCAR_U64 = 3, TROCAR_F32 = 4, TROCAR_F64 = 5 } trocar_type;

/* An array or number of a world where it lies: rows x columns elements, row-major, no gaps. */
typedef struct {
    uint32_t size;
    uint32_t type;     /* trocar_type */
    void* data;        /* null if rows is 0 */
    uint64_t rows;     /* 1 for a number */
    uint32_t columns;  /* 1, or components of a vector */
    uint32_t fixed;    /* 1: valid until trocar_close. 0: only until the next call that changes the world */
    uint32_t writable; /* 1: state that a program may set between two passes; else read only */
    uint32_t reserved;
    char unit[32]; /* "m", "N"; "index of bodies" for an index; empty without one */
} trocar_view;

/* Number of arrays, and the name of one: valid until trocar_close. Null if there is no such index. */
uint32_t trocar_array_count(const trocar_world* world);
const char* trocar_array_name(const trocar_world* world, uint32_t index);
/* The array of a name, as captures and components/NAME.hpp have them: "particles.offset" (m from the body's origin and
 * inverse mass), "poses.origin", "contacts.distance", "energy.kinetic", "report.self_crossings". */
trocar_code trocar_array(trocar_world* world, const char* name, trocar_view* view);

/* ---- bodies ------------------------------------------------------------------------------------------------- */

typedef enum { TROCAR_BODY = 0, TROCAR_TOOL = 1, TROCAR_LINK = 2 } trocar_kind;
typedef enum { TROCAR_STATIC = 0, TROCAR_KINEMATIC = 1, TROCAR_HAND = 2, TROCAR_DEFORMABLE = 3, TROCAR_FREE = 4 } trocar_motion;

/* How many of a kind, the index of a name (a tool has that of its body; a free slot of links has none), and the name of an
 * index with a final 0. */
uint32_t trocar_count(const trocar_world* world, trocar_kind kind);
trocar_code trocar_find(const trocar_world* world, trocar_kind kind, const char* name, uint32_t* index);
trocar_code trocar_name(const trocar_world* world, trocar_kind kind, uint32_t index, char* text, size_t capacity, size_t* length);

typedef struct {
    uint32_t size;
    uint32_t motion;         /* trocar_motion */
    uint32_t vertices;       /* of its surface */
    uint32_t triangles;      /* of its surface now */
    uint32_t first_particle; /* deformable: row of "particles.offset" of its first vertex */
    uint32_t particles;      /* rows; 0 for rigid bodies */
    double origin[3];        /* m */
    double orientation[4];
    double mass; /* kg; 0 for static and kinematic bodies */
} trocar_body;

trocar_code trocar_get_body(const trocar_world* world, uint32_t body, trocar_body* out);
/* World positions of its vertices, m: 3 doubles each; corners of its triangles: 3 indices of vertices each, counter-clockwise
 * from outside. capacity and *count are vertices and triangles. */
trocar_code trocar_vertices(const trocar_world* world, uint32_t body, double* xyz, size_t capacity, size_t* count);
trocar_code trocar_triangles(const trocar_world* world, uint32_t body, uint32_t* corners, size_t capacity, size_t* count);

/* The point of a body's surface nearest to a point. */
typedef struct {
    double distance;  /* m; negative inside a closed surface */
    double point[3];  /* m, world */
    double normal[3]; /* unit, outward */
    uint32_t triangle;
    uint32_t reserved;
} trocar_nearest;
/* Signed distances of `count` world points (3 doubles each) to a body as it is now, certified to rounding. out: count. */
trocar_code trocar_distance(trocar_world* world, uint32_t body, const double* points, size_t count, trocar_nearest* out);

/* Pushes a body at a world point with an impulse, N s, between two passes: a free body turns too; of a deformable one the
 * nearest vertex that is not fixed takes it. Its work is booked as "energy.work_hand". TROCAR_BAD_CALL for other motions. */
trocar_code trocar_push(trocar_world* world, uint32_t body, const double point[3], const double impulse[3]);

/* ---- tools -------------------------------------------------------------------------------------------------- */

/* Where the hand of a tool is to go, in the frame of its device (world, unless the scene has tool.workspace). */
typedef struct {
    uint32_t size;
    uint32_t buttons;      /* bits, held from now on */
    double position[3];    /* m */
    double orientation[4]; /* all 0: as it is */
    double grip;           /* rad between the jaws; negative: as it is */
    double seconds;        /* it moves there evenly in this time; 0: in the next pass. Then it rests */
} trocar_target;
/* Takes a tool out of its script. TROCAR_BAD_INPUT if the hand would be faster than 2 m/s, which a tick refuses. */
trocar_code trocar_set_target(trocar_world* world, uint32_t tool, const trocar_target* target);
/* Gives a tool back to its script. */
trocar_code trocar_release_tool(trocar_world* world, uint32_t tool);

typedef struct {
    uint32_t size;
    uint32_t body;         /* of the instrument */
    uint32_t touched;      /* body that its proxy touches; TROCAR_NONE */
    uint32_t contacts;     /* surface constraints on the proxy */
    double device[3];      /* m, world: where the hand is */
    double orientation[4]; /* of the hand */
    double proxy[3];       /* m, world: the tip, kept outside surfaces */
    double force[3];       /* N, on the hand: what a device is told */
    double torque[3];      /* N m, on the hand, about the tip */
    double tissue[3];      /* N, of tissue on the simulated tool, mean over the last pass */
    double links[3];       /* N, of links on it, mean over the last pass */
    double grip;           /* rad */
    double grip_torque;    /* N m, on the fingers, mean over the last pass */
} trocar_tool;
trocar_code trocar_get_tool(const trocar_world* world, uint32_t tool, trocar_tool* out);

/* ---- contacts and links ------------------------------------------------------------------------------------- */

/* A point of one body's surface near or inside another body, as the last pass found it at its start. */
typedef struct {
    uint32_t body, other;
    uint32_t vertex[2];  /* of body; equal at a vertex, else ends of the edge */
    uint32_t third;      /* third corner of a point inside a face; TROCAR_NONE */
    uint32_t triangle;   /* of other */
    float along, across; /* point = (1 - along - across) vertex[0] + along vertex[1] + across third */
    double point[3];     /* m, world */
    double closest[3];   /* m, world, on the surface of other */
    double normal[3];    /* unit, outward from other */
    double distance;     /* m, negative inside */
} trocar_contact;
trocar_code trocar_contacts(const trocar_world* world, trocar_contact* out, size_t capacity, size_t* count);

/* An overlapping pair of bodies. */
typedef struct {
    uint32_t a, b;
    uint32_t overlap;   /* 1: they have a common point */
    uint32_t saturated; /* 1: so deep that other directions are about as short */
    uint32_t a_in_b;    /* vertices of a inside b */
    uint32_t b_in_a;
    double depth;         /* m: the largest of the shortest distances of points inside */
    double surface_depth; /* m: the same over whole faces (contact.faces); else depth */
    double direction[3];  /* unit, in which b leaves a */
    uint32_t witness;     /* index of the contact that is deepest; TROCAR_NONE */
    uint32_t reserved;
} trocar_pair;
/* Pairs whose surfaces overlapped in the last pass. */
trocar_code trocar_pairs(const trocar_world* world, trocar_pair* out, size_t capacity, size_t* count);

/* A group of links: springs from nodes of a deformable body to a holder. */
typedef struct {
    uint32_t size;
    uint32_t body, holder; /* TROCAR_NONE: a free slot; of holder alone: the world */
    uint32_t holding;      /* links now */
    uint64_t made, broken; /* so far */
    double force[3];       /* N, of the holder on the body, mean over the last pass */
    double largest_force;  /* N, so far */
    double largest_strain;
} trocar_link;
trocar_code trocar_get_link(const trocar_world* world, uint32_t link, trocar_link* out);

/* One stiff link between the nodes of two bodies nearest to a point. */
typedef struct {
    uint32_t size;
    uint32_t a; /* deformable */
    uint32_t b; /* deformable or rigid */
    uint32_t reserved;
    double position[3];  /* m, world */
    double reach;        /* m, no farther from the node of a; 0 = 0.01 */
    double stiffness;    /* N/m */
    double rest;         /* m; 0 = as far apart as they are */
    double break_strain; /* 0 = never */
} trocar_staple;
/* Staples between two passes; *link: its index for trocar_get_link. The scene must reserve room: staples = N. */
trocar_code trocar_add_staple(trocar_world* world, const trocar_staple* staple, uint32_t* link);
/* Takes a group of links off; its slot is free for another. */
trocar_code trocar_remove_link(trocar_world* world, uint32_t link);

/* ---- records and pictures ----------------------------------------------------------------------------------- */

/* Records every pass from now on for a capture (.cap): `trocar replay`, `trocar capture`. Null ends recording and writes the
 * file; so does another file. TROCAR_BAD_INPUT if it cannot be written. A world that is closed while it records writes none. */
trocar_code trocar_record(trocar_world* world, const char* file);

typedef struct {
    uint32_t size;
    uint32_t width, height;            /* pixels; 0 = 640 x 480 */
    uint32_t wireframe, depth_colours; /* 1 = on */
    uint32_t plain;                    /* 1: no markers, no text */
    uint32_t own_camera;               /* 1: an orbit by the members below; 0: the scene's */
    uint32_t reserved;
    double target[3];     /* m */
    double distance;      /* m; 0: fitted to the bodies */
    double azimuth;       /* rad, about the vertical; 0: from +x */
    double elevation;     /* rad */
    double field_of_view; /* rad, vertical; 0 = 35 degrees */
} trocar_picture;
/* Draws the present state: sRGB, 3 bytes a pixel, rows top to bottom. *length: bytes needed, 3 x width x height. */
trocar_code trocar_draw(trocar_world* world, const trocar_picture* picture, uint8_t* rgb, size_t capacity, size_t* length);

/* ---- batches ------------------------------------------------------------------------------------------------ */

/* Worlds of one scene that share its meshes and all else that is constant: each costs its state alone, stepped on its own
 * thread, and gives the bits of a world opened by itself. */
typedef struct trocar_batch trocar_batch;
/* threads: 0 = all cores. */
trocar_code trocar_batch_open(const trocar_scene* scene, uint32_t worlds, uint32_t threads, trocar_batch** batch);
void trocar_batch_close(trocar_batch* batch);
uint32_t trocar_batch_count(const trocar_batch* batch);
/* Steps every world by as many passes; returns when all are done. */
trocar_code trocar_batch_step(trocar_batch* batch, uint32_t passes);
/* One world of the batch, as it is now: its state is loaded into a world that the batch owns, for every function above but
 * trocar_step, trocar_step_until, trocar_record and trocar_close (TROCAR_BAD_CALL). What was changed there (targets, state,
 * arrays) becomes the state of that world of the batch. Valid until the next call on the batch; the views too. What a
 * pass derives (contacts) is empty: see trocar_batch_keep. */
trocar_code trocar_batch_world(trocar_batch* batch, uint32_t index, trocar_world** world);
/* From the next step on keeps a derived array ("contacts.distance") of every world, to be read by trocar_batch_array. */
trocar_code trocar_batch_keep(trocar_batch* batch, const char* array);
/* An array kept by trocar_batch_keep, or one of the state, of one world. Valid until the next call on the batch but this. */
trocar_code trocar_batch_array(trocar_batch* batch, uint32_t index, const char* array, trocar_view* view);
/* Bytes of memory of one world's state, without arrays kept, and of what all share (copies per thread included; scratch of stages
 * is not). */
trocar_code trocar_batch_memory(const trocar_batch* batch, uint64_t* each, uint64_t* shared);

/* ---- contact alone ------------------------------------------------------------------------------------------ */

/* Contact of deforming meshes without a world: the detection of `trocar collide`, to the bit. */
typedef struct trocar_collider trocar_collider;

typedef struct {
    uint32_t size;
    uint32_t vertices, triangles;
    uint32_t reserved;
    const double* xyz;       /* m, world: 3 a vertex. Corners of triangles that meet must be the same vertex */
    const uint32_t* corners; /* 3 a triangle, counter-clockwise from outside */
} trocar_mesh;

typedef struct {
    uint32_t size;
    uint32_t no_faces; /* 1: deepest points at vertices and along edges only: faster, see trocar_pair::surface_depth */
    double tolerance;  /* m, of the deepest point along edges and in faces; 0 = 1e-4 of the smallest diagonal */
} trocar_collider_options;

/* Takes copies of the meshes and judges each: closed ones have an inside, open ones are sheets without thickness.
 * options may be null. TROCAR_BAD_INPUT: "mesh 1, triangle 17: reason". */
trocar_code trocar_collider_open(const trocar_mesh* meshes, uint32_t count, const trocar_collider_options* options,
                                 trocar_collider** collider);
void trocar_collider_close(trocar_collider* collider);

typedef enum { TROCAR_SOLID = 0, TROCAR_WINDING = 1, TROCAR_SHEET = 2 } trocar_admission;
/* How a mesh was judged: solid (side by pseudonormal), winding (closed, but flawed: side by winding number), sheet (open). */
trocar_code trocar_collider_admission(const trocar_collider* collider, uint32_t mesh, trocar_admission* admission);
/* New positions of all vertices of a mesh, 3 doubles each. It keeps the judgement. */
trocar_code trocar_collider_move(trocar_collider* collider, uint32_t mesh, const double* xyz);
/* Finds contacts of all pairs at the present positions. */
trocar_code trocar_collider_find(trocar_collider* collider);
/* What the last trocar_collider_find found; bodies are indices of meshes. trocar_collider_pairs has every pair with boxes that
 * meet; regions are the connected parts of the overlaps of closed meshes. */
trocar_code trocar_collider_pairs(const trocar_collider* collider, trocar_pair* out, size_t capacity, size_t* count);
trocar_code trocar_collider_contacts(const trocar_collider* collider, trocar_contact* out, size_t capacity, size_t* count);
typedef struct {
    uint32_t a, b;
    uint32_t a_in_b, b_in_a; /* vertices */
    uint32_t curves;         /* where the surfaces cross */
    uint32_t witness;        /* index of the deepest contact; TROCAR_NONE */
    double contour;          /* m, length of the curves */
    double area;             /* m^2, of its boundary */
    double volume;           /* m^3 */
    double depth;            /* m */
    double direction[3];     /* unit, in which b leaves a; zero without a witness */
} trocar_region;
trocar_code trocar_collider_regions(const trocar_collider* collider, trocar_region* out, size_t capacity, size_t* count);

#ifdef __cplusplus
}
#endif
#endif
