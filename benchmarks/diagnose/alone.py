"""Run a command; print its answer, its processor seconds and its largest memory, MiB, as JSON.

The system counts in the largest memory of a process that of the process which started it. This one is small.
"""

import json
import resource
import subprocess
import sys

answer = subprocess.run(sys.argv[1:], stdout=subprocess.PIPE, text=True, check=True).stdout
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps({"answer": answer, "all": used.ru_utime + used.ru_stime, "memory": used.ru_maxrss / 1024}))
