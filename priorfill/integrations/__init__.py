"""Fill trials inside the programs that record them.

* `priorfill.integrations.nexus`: the trial that is open in Vicon Nexus (docs/nexus.md),
* `priorfill.integrations.qtm`: the measurement that is open in Qualisys Track Manager
  (docs/qtm.md).

Both are adapters of `priorfill.integrations.open_trial`, which reads, fills, checks and sets. They
import the interfaces of the programs when they are used. They follow the documentation of the
vendors and were tested with stubs of these interfaces, not with the programs.
"""
