"""The closed-form procedure of Antonelli et al. (2010): four steps, a file each."""
