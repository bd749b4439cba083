#include "content/scene/tissues.hpp"

namespace trocar {
namespace {

// Young's modulus Pa, density kg/m^3, wall m, depth m; resistance of the enclosed volume and of the wall to bending, as multiples
// of Young's modulus. The wall of a hollow organ is the whole tissue and resists bending; an open sheet encloses nothing.
Tissue tissue_of(double modulus, double density, double wall, double depth, double volume, double bending) {
    Tissue t;
    t.youngs_modulus = modulus, t.density = density;
    t.wall = wall, t.depth = depth;
    t.damping = 30, t.friction = 0.1;
    t.pressure_modulus = volume * modulus, t.bending = bending * modulus;
    return t;
}

}  // namespace

std::span<const TissuePreset> tissue_presets() {
    static const TissuePreset kPresets[] = {
        {"liver",
         "E: mean of 530 healthy adults, transient elastography, Fung et al., PLoS ONE 8(12) e85067, 2013 (2.3 to 5.9 kPa). "
         "density: Kaye & Laby, Tables, 2.4.6",
         tissue_of(4.1e3, 1060, 8e-3, 0.05, 10, 0)},
        {"kidney",
         "E: cortex in vivo (rabbit), shear wave elastography, BMC Nephrology, doi 10.1186/s12882-017-0679-2, 2017. "
         "density: Kaye & Laby, Tables, 2.4.6",
         tissue_of(16.3e3, 1050, 5e-3, 0.03, 10, 0)},
        {"spleen",
         "E: 2.9 +- 1.8 kPa, 127 healthy adults, shear wave elastography, Arda et al., Am J Roentgenol 197(3), 2011 (16.6 +- 2.5 kPa in "
         "another study of 59 healthy adults, pmc.ncbi.nlm.nih.gov PMC5059412: devices differ). density: no source, that of the liver",
         tissue_of(2.9e3, 1060, 5e-3, 0.03, 10, 0)},
        {"gallbladder",
         "E = 3 G, G 85 kPa and density: table 1 of Phys Med Biol 64(22) 225001, 2019, after Karimi et al., J Med Eng Technol, 2017",
         tissue_of(255e3, 1060, 2e-3, 1.0, 10, 1)},
        {"bowel",
         "E: small intestine (pig), biaxial, low strain, mean of 307 kPa along and 180 kPa around, Terry et al., IJECB 2(4), 2014. "
         "density: no source, that of muscle",
         tissue_of(244e3, 1047, 2e-3, 1.0, 10, 1)},
        {"fat",
         "E = 3 |G|, |G| 752 Pa in vivo, magnetic resonance elastography, J Mech Behav Biomed Mater, 2023 (strain-dependent shear "
         "of human adipose tissue). density: Kaye & Laby, Tables, 2.4.6",
         tissue_of(2.3e3, 923, 5e-3, 0.03, 10, 0)},
        {"muscle",
         "E = 3 |G|, |G| 1000 Pa, relaxed gluteus in vivo, the same study as of fat; abdominal wall in tension 20 to 50 kPa "
         "(linea alba, Foerstemann et al., J Biomech, 2011). density: Kaye & Laby, Tables, 2.4.6",
         tissue_of(3e3, 1047, 8e-3, 0.03, 10, 0)},
        {"vessel",
         "E: 701 to 983 kPa, the means of women of 45 to 49 and of men of 60 to 64 years, common carotid artery in vivo, ultrasound, Riley "
         "et al., Stroke 23, 1992; their middle. An artery: veins are softer. density: no source, that of muscle",
         tissue_of(842e3, 1047, 1e-3, 1.0, 10, 1)},
        {"peritoneum", "E: no source, chosen, within the order of the bowel's wall. density: no source, that of muscle. wall: chosen",
         tissue_of(200e3, 1047, 0.5e-3, 1.0, 0, 1)},
        {"polypropylene_mesh",
         "stretch: 1 N/mm, within the 0.3 to 4.6 of six meshes of Pott et al., PLoS ONE 7(10) e46978, 2012; knits differ by two "
         "orders of magnitude (Maurer et al., Materials 8, 2015). 50 g/m^2 at 0.5 mm: chosen. bending: no source, that of a plate of "
         "this wall and modulus. Explicit steps of a fine mesh are microseconds: take integrator = \"implicit\"",
         tissue_of(2e6, 100, 0.5e-3, 10, 0, 1)},
    };
    return kPresets;
}

const TissuePreset* find_tissue(const std::string& name) {
    for (const TissuePreset& preset : tissue_presets())
        if (name == preset.name) return &preset;
    return nullptr;
}

std::string tissue_names() {
    std::string list;
    for (const TissuePreset& preset : tissue_presets()) list += (list.empty() ? "" : ", ") + std::string(preset.name);
    return list;
}

}  // namespace trocar
