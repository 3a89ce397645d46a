"""Figures of some kinds of leaf, in SI units, each with its source.

Leaves of one kind differ by far more than a preset can say: give what is known of the leaf at hand. Where a source
gives no figure that could be taken over, the comment says "chosen here"; "order" means that only the order of magnitude
is supported. Full references:

- Balsamo, Vander Willigen, Bauer, Farrant 2006, Annals of Botany 97: a grass leaf is stiffer below its turgor loss.
- Bartlett, Scoffoni, Sack 2012, Ecology Letters 15: osmotic potential, bulk modulus and turgor loss of 317 species.
- Blonder et al. 2012, American J. Botany 99: area that 3,401 leaves of 380 species lost on drying, 22 % in the mean, up
  to 82 %.
- Falk, Hertz, Virgin 1958, Physiologia Plantarum 11: the rigidity of a tissue follows its turgor.
- Juneau, Tarasoff 2012, PLoS ONE 7: pressed leaves lose 18 % of their area in the mean, woody dicots the least.
- Kobayashi, Daimaruya, Kuribayashi 2000, J. Soc. Materials Science Japan 49: Young's modulus of butterbur (a large
  herb): veins 60 MPa, eleven times the lamina's.
- Poorter, Niinemets, Poorter, Wright, Villar 2009, New Phytologist 182: dry mass per area by kind of plant.
- Read, Sanson 2003, New Phytologist 160: sclerophyllous leaves are stiffer than soft ones, in flexure, too.
- Saito, Soga, Hoson, Terashima 2006, Plant and Cell Physiology 47: bulk modulus of oak leaves, 5 MPa young to 20 MPa.
- Scoffoni et al. 2014, Plant Physiology 164: leaves of high bulk modulus and osmotic potential shrink the least.
- Vile et al. 2005, Annals of Botany 96: thickness is close to fresh mass per area over the density of water.
- Vincent 1982, J. Materials Science 17: fibres give 90 to 95 % of a grass leaf's stiffness along it.
- Wright et al. 2004, Nature 428: dry mass per area of 2,548 species.
"""

from __future__ import annotations

PRESETS: dict[str, dict[str, float]] = {
    # A thin, soft leaf of a herb, such as butterbur or lettuce.
    "herb": {
        "thickness": 2.2e-4,  # [m] Vile 2005, from the two masses
        "vein_thickness": 2.0e-3,  # [m] chosen here: a petiole and midrib of about 2 mm
        "lamina_modulus": 5.5e6,  # [Pa] Kobayashi 2000
        "vein_modulus": 6.0e7,  # [Pa] Kobayashi 2000
        "poisson_ratio": 0.3,  # chosen here
        "dry_mass": 0.04,  # [kg/m^2] order: Poorter 2009, herbs 30 to 60 g/m^2
        "saturated_water": 0.18,  # [kg/m^2] chosen here: a dry matter content of 18 %
        "osmotic_potential": 0.9e6,  # [Pa] order: Bartlett 2012, at the weak end
        "bulk_modulus": 9.0e6,  # [Pa] order: Bartlett 2012; turgor lost at 0.90
        "wilted_stiffness": 0.15,  # chosen here; that it falls: Falk 1958
        "dry_stiffness": 8.0,  # chosen here; that it rises: Balsamo 2006
        "shrink_across": 0.20,  # with the next, 32 % of the area: more than the mean of Blonder 2012, as herbs do
        "shrink_along": 0.15,  # (Juneau 2012); the two directions: chosen here
        "mismatch": 0.015,  # artistic
        "plastic_set": 0.0,  # artistic: none
    },
    # A leaf of a deciduous tree, such as beech, lime or oak.
    "tree": {
        "thickness": 2.0e-4,  # [m] Vile 2005, from the two masses
        "vein_thickness": 1.5e-3,  # [m] chosen here: a petiole and midrib of 1 to 2 mm
        "lamina_modulus": 5.0e7,  # [Pa] chosen here, between Kobayashi 2000 (herb) and a grass
        "vein_modulus": 2.5e8,  # [Pa] chosen here, of the order of a grass's fibres and cells together
        "poisson_ratio": 0.3,  # chosen here
        "dry_mass": 0.08,  # [kg/m^2] order: Wright 2004, Poorter 2009, deciduous trees 50 to 100 g/m^2
        "saturated_water": 0.12,  # [kg/m^2] chosen here: a dry matter content of 40 %
        "osmotic_potential": 1.5e6,  # [Pa] order: Bartlett 2012, woody plants 1 to 2.5 MPa
        "bulk_modulus": 1.2e7,  # [Pa] Saito 2006, within 5 to 20 MPa; turgor lost at 0.875
        "wilted_stiffness": 0.3,  # chosen here; that it falls: Falk 1958
        "dry_stiffness": 5.0,  # chosen here; that it rises: Balsamo 2006
        "shrink_across": 0.14,  # with the next, 22 % of the area: the mean of Blonder 2012;
        "shrink_along": 0.09,  # the two directions: chosen here
        "mismatch": 0.01,  # artistic
        "plastic_set": 0.0,  # artistic: none
    },
    # A thick leaf with a strong cuticle, such as ivy or a rubber plant.
    "waxy": {
        "thickness": 5.0e-4,  # [m] Vile 2005, from the two masses
        "vein_thickness": 1.5e-3,  # [m] chosen here
        "lamina_modulus": 1.0e8,  # [Pa] chosen here; that it is above the tree's: Read 2003
        "vein_modulus": 3.0e8,  # [Pa] chosen here
        "poisson_ratio": 0.3,  # chosen here
        "dry_mass": 0.15,  # [kg/m^2] order: Wright 2004, Poorter 2009, evergreens 100 to 200 g/m^2
        "saturated_water": 0.35,  # [kg/m^2] chosen here: a dry matter content of 30 %
        "osmotic_potential": 1.6e6,  # [Pa] order: Bartlett 2012
        "bulk_modulus": 1.8e7,  # [Pa] order: Bartlett 2012; turgor lost at 0.91
        "wilted_stiffness": 0.6,  # chosen here: much of it is cuticle and fibres, not turgor
        "dry_stiffness": 3.0,  # chosen here
        "shrink_across": 0.08,  # with the next, 13 % of the area: less than the mean of Blonder 2012, as leaves of high
        "shrink_along": 0.05,  # bulk modulus do (Scoffoni 2014); the two directions: chosen here
        "mismatch": 0.01,  # artistic
        "plastic_set": 0.0,  # artistic: none
    },
    # The blade of a meadow grass; "vein" is a bundle with its fibres.
    "grass": {
        "thickness": 1.7e-4,  # [m] Vile 2005, from the two masses
        "vein_thickness": 7.0e-4,  # [m] chosen here: the keel of its midrib
        "lamina_modulus": 2.0e7,  # [Pa] chosen here; with the next and a third of the width in bundles, these carry
        "vein_modulus": 4.0e8,  # [Pa] 90 to 95 % of a pull: Vincent 1982; order of the sum: chosen here
        "poisson_ratio": 0.3,  # chosen here
        "dry_mass": 0.045,  # [kg/m^2] order: Poorter 2009, grasses 30 to 60 g/m^2
        "saturated_water": 0.125,  # [kg/m^2] chosen here: a dry matter content of 26 %
        "osmotic_potential": 1.3e6,  # [Pa] order: Bartlett 2012
        "bulk_modulus": 1.0e7,  # [Pa] order: Bartlett 2012; turgor lost at 0.87
        "wilted_stiffness": 0.4,  # chosen here; that it falls: Falk 1958
        "dry_stiffness": 4.0,  # chosen here; that it rises: Balsamo 2006
        "shrink_across": 0.20,  # with the next, 22 % of the area: the mean of Blonder 2012; a blade narrows rather than
        "shrink_along": 0.03,  # shortens, since its fibres run along it: chosen here
        "mismatch": 0.015,  # artistic: it rolls
        "plastic_set": 0.0,  # artistic: none
    },
}
