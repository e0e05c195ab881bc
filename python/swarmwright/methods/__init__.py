"""Optimization methods, which propose candidates for evaluation.

`METHODS.names()` lists the kinds of an experiment's `method`, including plug-ins;
`METHODS.get("cma_es")` is the class of one, and its `options_model` has its options with their defaults.
An experiment makes its method by `Experiment.new_method()`, which your own loop can ask and tell. A custom
method is a class derived from `Method`: docs/how-to/plug-ins.md.
"""

from swarmwright.common.registry import Registry
from swarmwright.methods._base import Method, MethodOptions

__all__ = ["METHODS", "Method", "MethodOptions"]

METHODS: Registry[Method] = Registry(
    "method",
    "swarmwright.methods",
    {
        "cea2d": "swarmwright.methods.cea2d:Cea2d",
        "cma_es": "swarmwright.methods.cma_es:CmaEs",
        "cuckoo_search": "swarmwright.methods.cuckoo_search:CuckooSearch",
        "de": "swarmwright.methods.de:De",
        "evostick": "swarmwright.methods.evostick:Evostick",
        "ga_species": "swarmwright.methods.ga_species:GaSpecies",
        "map_elites": "swarmwright.methods.map_elites:MapElites",
        "neat": "swarmwright.methods.neat:Neat",
        "nnga": "swarmwright.methods.nnga:Nnga",
        "novelty": "swarmwright.methods.novelty:Novelty",
        "nsga2": "swarmwright.methods.nsga2:Nsga2",
        "nsga3": "swarmwright.methods.nsga3:Nsga3",
        "openai_es": "swarmwright.methods.openai_es:OpenaiEs",
        "pgpe": "swarmwright.methods.pgpe:Pgpe",
        "pso": "swarmwright.methods.pso:Pso",
        "racing": "swarmwright.methods.racing:Racing",
        "random_search": "swarmwright.methods.random_search:RandomSearch",
        "sep_cma_es": "swarmwright.methods.sep_cma_es:SepCmaEs",
        "snes": "swarmwright.methods.snes:Snes",
        "tpe": "swarmwright.methods.tpe:Tpe",
        "xnes": "swarmwright.methods.xnes:Xnes",
    },
    "swarmwright.methods:Method",
    in_files=True,
)
"""All methods, by the `kind` of an experiment's `method`; `METHODS.get("file.py:Class")` is one in a file."""
