"""Run a command; print its processor seconds and its largest memory, MiB, as JSON.

The system counts in the largest memory of a process that of the process which started it. This one is small.
"""

import json
import resource
import subprocess
import sys

subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, check=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps({"all": used.ru_utime + used.ru_stime, "memory": used.ru_maxrss / 1024}))
