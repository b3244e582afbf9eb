"""How every scheme grows with the model: from 10³ to 10⁶ halfspaces; and what laziness saves."""
